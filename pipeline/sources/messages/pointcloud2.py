"""The one decoder of `sensor_msgs/PointCloud2`: any field layout in, `Scan` out.

The message's bytes are viewed in place as records, and their fields copied out block by block, so that a block's bytes
are read from memory once.  Points that are no returns (NaN, infinite, at the origin) are then closed up, with their
times and intensities, while the block is in the processor's cache.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.field_names import are_of_flight, intensity_field, like_times, time_fields
from wiclosure.pipeline.sources.messages.headers import HeaderMessage, nanoseconds_of
from wiclosure.pipeline.sources.messages.timed_scans import FARTHEST_M, TimedScans
from wiclosure.types import Float32Array, FloatArray, Scan

logger = logging.getLogger(__name__)

# sensor_msgs/PointField's numbers; 9 to 11 are new in ROS 2 Lyrical, and in use before that.
FORMATS: Mapping[int, str] = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8", 9: "i8", 10: "u8", 11: "u1"
}  # fmt: skip

_NEAREST_M = 1e-9  # nothing is measured so finely; floats whose bytes are swapped are mostly smaller, or very large
_BLOCK = 32_768  # points; a block's bytes stay in the processor's cache while its fields are copied

Records: TypeAlias = NDArray[np.void]


class PointFieldMessage(Protocol):
    """`sensor_msgs/PointField`, as rosbags makes it."""

    name: str
    offset: int
    datatype: int
    count: int


class PointCloud2Message(Protocol):
    """`sensor_msgs/PointCloud2`, as rosbags makes it."""

    @property
    def header(self) -> HeaderMessage: ...  # noqa: D102
    @property
    def fields(self) -> Sequence[PointFieldMessage]: ...  # noqa: D102

    height: int
    width: int
    is_bigendian: bool
    point_step: int
    row_step: int
    data: NDArray[np.uint8]


Fields: TypeAlias = tuple[tuple[str, int, int, int], ...]
"""Name, offset, datatype and count of each field."""


class PointCloud2Decoder:
    """Decodes the messages of one topic in order; remembers what its per-point times mean (see `point_times`).

    Args:
        place: what is read, for the log.
        period_s: seconds from scan to scan, where they are known.
    """

    def __init__(self, place: str = "", period_s: float | None = None) -> None:
        self._place = place or "point clouds"
        self._scan = TimedScans(place, period_s)
        self._layouts: dict[tuple[Any, ...], np.dtype[np.void]] = {}

    def decode(self, cloud: PointCloud2Message, stamp_ns: int | None = None) -> Scan:
        """The returns of one message; a default message, without points or fields, has none.

        Args:
            cloud: the message.
            stamp_ns: the scan's stamp; None: the header's.

        Raises:
            InputError: the fields x, y, z are missing or do not fit, or the data is shorter than announced.
        """
        stamp_ns = nanoseconds_of(cloud.header.stamp) if stamp_ns is None else stamp_ns
        if cloud.height * cloud.width == 0 or (not cloud.fields and len(cloud.data) == 0):
            return Scan(stamp_ns, np.zeros((0, 3)))
        points, times, intensity, are_near = _returns(_records(cloud, self._layout(cloud)))
        return self._scan(stamp_ns, points, times, intensity, are_near=are_near)

    def _layout(self, cloud: PointCloud2Message) -> np.dtype[np.void]:
        fields = tuple((field.name, field.offset, field.datatype, field.count) for field in cloud.fields)
        key = (fields, bool(cloud.is_bigendian), cloud.point_step)
        if key not in self._layouts:
            order = self._byte_order(fields, cloud)
            time = self._time_field(fields, cloud, order)
            self._layouts[key] = _record_type(fields, time, order, cloud.point_step)
        return self._layouts[key]

    def _byte_order(self, fields: Fields, cloud: PointCloud2Message) -> str:
        """As stated, unless only the other one makes coordinates of the bytes: PCL does not look at what is stated."""
        stated, other = (">", "<") if cloud.is_bigendian else ("<", ">")
        if _share_of_coordinates(fields, cloud, stated) > 0.5 or _share_of_coordinates(fields, cloud, other) < 0.9:
            return stated
        logger.warning("%s: is_bigendian is wrong, its bytes are in the other order; read so", self._place)
        return other

    def _time_field(self, fields: Fields, cloud: PointCloud2Message, order: str) -> str | None:
        """The field of per-point times: of several, the first whose values differ; what is not used is said."""
        names = [name for name, *_ in fields]
        candidates = time_fields(names)
        differing = []
        for name in list(candidates):
            records = _records(cloud, _record_type(fields, name, order, cloud.point_step))
            values = records["time"]
            if are_of_flight(name, values, records["x"], records["y"], records["z"]):
                candidates.remove(name)
            elif len(known := values[np.isfinite(values)]) and known.min() < known.max():
                differing.append(name)
        if candidates and not differing:
            logger.warning(
                "%s: field %s is the same for all points: the scans are not deskewed", self._place, candidates[0]
            )
        if not candidates and (similar := like_times(names, ())):
            logger.warning(
                "%s: field %s looks like per-point times but is not used: the scans are not deskewed; name it time"
                " where it is one", self._place, similar[0],
            )  # fmt: skip
        return next(iter(differing or candidates), None)


def are_returns(x: NDArray[Any], y: NDArray[Any], z: NDArray[Any]) -> NDArray[np.bool_]:
    """Which points `(N,)` are finite and not at the origin, where drivers put beams without a return."""
    return _are_near(_sizes(x, y, z))


def _are_near(sizes: NDArray[Any]) -> NDArray[np.bool_]:
    return np.asarray((sizes != 0) & (sizes < np.inf))  # the latter is false for NaN


def _sizes(x: NDArray[Any], y: NDArray[Any], z: NDArray[Any]) -> NDArray[Any]:
    """Sums `(N,)` of the coordinates' absolute values."""
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.add(np.abs(x), np.abs(y))
        return np.asarray(np.add(size, np.abs(z), out=size if size.dtype == np.result_type(size, z) else None))


def _share_of_coordinates(fields: Fields, cloud: PointCloud2Message, order: str) -> float:
    """How many of the finite points but those at the origin have coordinates as sensors measure them."""
    records = _records(cloud, _record_type(fields, None, order, cloud.point_step))[:_BLOCK]
    with np.errstate(invalid="ignore"):  # NaNs of the kind that signals
        size = np.abs(np.column_stack([records[axis].astype(np.float64) for axis in "xyz"]))
    size = size[np.isfinite(size).all(axis=1) & size.any(axis=1)]
    return float(((size == 0) | ((size > _NEAREST_M) & (size < FARTHEST_M))).all(axis=1).mean()) if len(size) else 1.0


def _record_type(fields: Fields, time: str | None, order: str, point_step: int) -> np.dtype[np.void]:
    """The record of one point: x, y, z and, where they exist, time and intensity; other fields are padding."""
    by_name = {name: (name, offset, datatype, count) for name, offset, datatype, count in reversed(fields)}
    by_axis = {name.lower(): name for name in by_name}
    wanted = {axis: by_axis.get(axis, axis) for axis in "xyz"}
    wanted |= {role: name for role, name in (("time", time), ("intensity", intensity_field(by_name))) if name}
    formats, offsets = [], []
    for name in wanted.values():
        if name not in by_name:
            present = ", ".join(field[0] for field in fields) or "none"
            raise InputError(f"the cloud has no field {name!r} (fields: {present}); choose a topic with x, y and z")
        formats.append(order + _format(*by_name[name][0::2], by_name[name][3]))
        offsets.append(by_name[name][1])
        if offsets[-1] + np.dtype(formats[-1]).itemsize > point_step:
            raise InputError(
                f"field {name!r} ends beyond the point ({offsets[-1]} + {np.dtype(formats[-1]).itemsize} bytes in a"
                f" point_step of {point_step}); the driver that recorded this cloud is at fault"
            )
    return np.dtype({"names": list(wanted), "formats": formats, "offsets": offsets, "itemsize": point_step})


def _format(name: str, datatype: int, count: int) -> str:
    """NumPy's name of a field's type."""
    if datatype == 6 and count == 2:  # PointField had no 64-bit integers for long: two of 32 bits stand for one
        return "u8"
    if datatype not in FORMATS:
        raise InputError(f"field {name!r} has the unknown datatype {datatype}; PointField knows 1 to {max(FORMATS)}")
    if count > 1:
        raise InputError(f"field {name!r} has {count} numbers a point; expected one")
    return FORMATS[datatype]


def _records(cloud: PointCloud2Message, layout: np.dtype[np.void]) -> Records:
    """The message's bytes as records `(N,)`; copied only where rows are padded."""
    height, width, step = cloud.height, cloud.width, cloud.point_step
    packed = width * step
    row_step = cloud.row_step if height > 1 and cloud.row_step >= packed else packed  # many drivers leave it wrong
    needed = (height - 1) * row_step + packed if height and width else 0
    if len(cloud.data) < needed:
        raise InputError(
            f"the cloud announces {height} x {width} points of {step} bytes but holds {len(cloud.data)} bytes of"
            f" {needed}; the recording is damaged"
        )
    if needed == 0:
        return np.zeros(0, layout)
    data = np.ascontiguousarray(cloud.data).data
    if row_step == packed:
        return np.ndarray((height * width,), layout, data)
    rows = np.ndarray((height, packed), np.uint8, data, strides=(row_step, 1))
    return np.ascontiguousarray(rows).reshape(-1).view(layout)


def _returns(records: Records) -> tuple[FloatArray, NDArray[Any] | None, Float32Array | None, bool]:
    """Points `(M, 3)`, times and intensity `(M,)` of the returns; whether all are known to be near."""
    names, count = records.dtype.names or (), len(records)
    points = np.empty((count, 3))
    others: dict[str, NDArray[Any]] = {}
    if "time" in names:
        others["time"] = np.empty(count, _wide(records.dtype["time"]))
    if "intensity" in names:
        others["intensity"] = np.empty(count, np.float32)
    end, are_near = 0, True
    for start in range(0, count, _BLOCK):
        block = records[start : start + _BLOCK]
        here = points[end : end + len(block)]
        for column, name in enumerate("xyz"):
            with np.errstate(invalid="ignore"):  # NaNs of the kind that signals
                here[:, column] = block[name]
        if here.max() < FARTHEST_M and here.min() > -FARTHEST_M and here[:, 0].all():  # both are false for NaN
            for name, values in others.items():
                values[end : end + len(block)] = block[name]
            end += len(block)
            continue
        are_near = False
        kept = np.flatnonzero(_are_near(_sizes(block["x"], block["y"], block["z"])))
        here[: len(kept)] = here.take(kept, axis=0, mode="clip")  # which spares it the check of each index
        for name, values in others.items():
            values[end : end + len(kept)] = block[name].take(kept, mode="clip")
        end += len(kept)
    times, intensity = (others[name][:end] if name in others else None for name in ("time", "intensity"))
    return points[:end], times, intensity, are_near


def _wide(dtype: np.dtype[Any]) -> type[np.float64] | type[np.int64]:
    """What holds the numbers of a type exactly, and is fast to reckon with."""
    return np.int64 if dtype.kind in "iu" and dtype.itemsize == 8 else np.float64
