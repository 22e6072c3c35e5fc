"""Point clouds compressed by Draco, as `point_cloud_transport` records them; needs DracoPy (the extra `draco`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.field_names import intensity_field, time_fields
from wiclosure.pipeline.sources.messages.headers import HeaderMessage
from wiclosure.pipeline.sources.messages.pointcloud2 import PointFieldMessage, are_returns
from wiclosure.pipeline.sources.messages.timed_scans import TimedScans
from wiclosure.types import Scan

_POSITION = 0  # Draco's number of this kind of attribute
_MERGED = {"x": ("x", "y", "z"), "nx": ("nx", "ny", "nz"), "normal_x": ("normal_x", "normal_y", "normal_z")}


_MOST_POINTS = 10_000_000  # of a message; a megabyte of Draco may announce any number


def _announced_points(head: bytes) -> int:
    """Points that Draco's header announces (its bitstream specification, 1.2, 4); 0 where it does not say at once."""
    has_metadata = len(head) < 15 or head[:5] != b"DRACO" or head[10] & 0x80
    return 0 if has_metadata else int.from_bytes(head[11:15], "little")


class CompressedCloud(Protocol):
    """`point_cloud_interfaces/CompressedPointCloud2`, as rosbags makes it."""

    @property
    def header(self) -> HeaderMessage: ...  # noqa: D102  -- named by ROS
    @property
    def fields(self) -> Sequence[PointFieldMessage]: ...  # noqa: D102

    format: str
    compressed_data: NDArray[np.uint8]


class DracoDecoder:
    """Decodes the messages of one topic.

    Args:
        place: what is read, for the log.
        period_s: seconds from scan to scan, where they are known.
    """

    def __init__(self, place: str = "", period_s: float | None = None) -> None:
        self._scan = TimedScans(place, period_s)

    def decode(self, cloud: CompressedCloud, stamp_ns: int) -> Scan:
        """The returns of one message.

        Raises:
            InputError: DracoPy is missing, the data are compressed otherwise, or damaged.
        """
        if len(cloud.compressed_data) == 0:
            return Scan(stamp_ns, np.zeros((0, 3)))
        if cloud.format != "draco":
            raise InputError(
                f"the clouds are compressed as {cloud.format!r}; only draco can be read. Decompress them with"
                " point_cloud_transport's republish"
            )
        columns = _columns(cloud)
        points = columns.pop("x").astype(np.float64)
        keep = are_returns(*points.T)
        time, intensity = next(iter(time_fields(columns)), None), intensity_field(columns)
        return self._scan(
            stamp_ns,
            points[keep],
            None if time is None else columns[time][keep, 0],
            None if intensity is None else columns[intensity][keep, 0],
        )


def _columns(cloud: CompressedCloud) -> dict[str, NDArray[Any]]:
    """Arrays `(N, components)` by field; `x` holds the points `(N, 3)`."""
    try:
        import DracoPy
    except ImportError as error:
        raise InputError(
            "the clouds are compressed by Draco; install DracoPy (pip install 'wiclosure[draco]'), or decompress them"
            " with point_cloud_transport's republish"
        ) from error
    if (announced := _announced_points(bytes(cloud.compressed_data[:16]))) > _MOST_POINTS:
        raise InputError(f"the compressed cloud announces {announced} points; no LiDAR makes so many")
    try:
        attributes = DracoPy.decode(bytes(cloud.compressed_data)).attributes
    except Exception as error:  # of its own kinds, and ValueError
        raise InputError(f"the compressed cloud cannot be decoded: {error}") from error
    # Its writer makes an attribute of each field, in their order; x y z, and normals, become one.
    merged = {name for names in _MERGED.values() for name in names[1:]}
    names = [field.name for field in cloud.fields if field.name.lower() not in merged]
    by_order = list(attributes)
    if len(names) != len(by_order) or not any(a["attribute_type"] == _POSITION for a in by_order):
        found = [a for a in by_order if a["attribute_type"] == _POSITION]
        if not found:
            raise InputError("the compressed cloud holds no positions; choose another topic")
        return {"x": np.asarray(found[0]["data"]).reshape(-1, 3)}
    arrays = {n.lower(): np.asarray(a["data"]) for n, a in zip(names, by_order, strict=True)}
    return {name: array.reshape(len(array), -1) for name, array in arrays.items()}
