"""The one decoder of `sensor_msgs/PointCloud2`: any field layout in, `Scan` out.

The message's bytes are viewed in place as records.  Points that are no returns (NaN, infinite, at the origin) are found
on that view, the remaining records are taken whole, and only then are the fields copied out: a point and its time and
intensity stay together by construction.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.point_times import PointClock
from wiclosure.types import Float32Array, FloatArray, Scan

POINT_CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
TIME_FIELDS = ("t", "time", "timestamp", "time_stamp", "offset_time")
INTENSITY_FIELDS = ("intensity", "i", "reflectivity")

# sensor_msgs/PointField's numbers; 9 to 11 are new in ROS 2 Lyrical, and in use before that.
FORMATS: Mapping[int, str] = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8", 9: "i8", 10: "u8", 11: "u1"
}  # fmt: skip

Records: TypeAlias = NDArray[np.void]


class TimeMessage(Protocol):
    """`builtin_interfaces/Time`, as rosbags makes it."""

    @property
    def sec(self) -> int: ...  # noqa: D102  -- named by ROS
    @property
    def nanosec(self) -> int: ...  # noqa: D102


class HeaderMessage(Protocol):
    """`std_msgs/Header`, as rosbags makes it."""

    @property
    def stamp(self) -> TimeMessage: ...  # noqa: D102
    @property
    def frame_id(self) -> str: ...  # noqa: D102


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


class PointCloud2Decoder:
    """Decodes the messages of one topic in order; remembers what its per-point times mean (see `point_times`)."""

    def __init__(self) -> None:
        self._clock = PointClock()
        self._layouts: dict[tuple[Any, ...], np.dtype[np.void]] = {}

    def decode(self, cloud: PointCloud2Message, received_ns: int = 0) -> Scan:
        """The returns of one message.

        Args:
            cloud: the message.
            received_ns: stamp to use where the header has none (zero).

        Raises:
            InputError: the fields x, y, z are missing or do not fit, or the data is shorter than announced.
        """
        stamp_ns = cloud.header.stamp.sec * 10**9 + cloud.header.stamp.nanosec or received_ns
        records = _records(cloud, self._layout(cloud))
        returns = are_returns(records["x"], records["y"], records["z"])
        records = _compact(records, returns)
        points = np.empty((len(records), 3))
        for column, name in enumerate("xyz"):
            points[:, column] = records[name]
        intensity = _column(records, "intensity")
        return timed_scan(self._clock, stamp_ns, points, _column(records, "time"), intensity)

    def _layout(self, cloud: PointCloud2Message) -> np.dtype[np.void]:
        fields = tuple((field.name, field.offset, field.datatype, field.count) for field in cloud.fields)
        key = (fields, bool(cloud.is_bigendian), cloud.point_step)
        if key not in self._layouts:
            self._layouts[key] = _record_type(fields, ">" if cloud.is_bigendian else "<", cloud.point_step)
        return self._layouts[key]


def are_returns(x: NDArray[Any], y: NDArray[Any], z: NDArray[Any]) -> NDArray[np.bool_]:
    """Which points `(N,)` are finite and not at the origin, where drivers put beams without a return."""
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.abs(x) + np.abs(y) + np.abs(z)
    return np.asarray((size != 0) & (size < np.inf))  # the latter is false for NaN


def timed_scan(
    clock: PointClock,
    stamp_ns: int,
    points: FloatArray,
    raw_times: NDArray[Any] | None,
    intensity: NDArray[Any] | None = None,
) -> Scan:
    """A scan of returns `(N, 3)` with their recorded times; points whose time is not a number are dropped."""
    if raw_times is not None and raw_times.dtype.kind == "f":
        timed = np.isfinite(raw_times)
        if not timed.any():
            raw_times = None
        elif not timed.all():
            points, raw_times = points[timed], raw_times[timed]
            intensity = None if intensity is None else intensity[timed]
    times = None if raw_times is None else clock.seconds_after(stamp_ns, raw_times)
    intensity32: Float32Array | None = None if intensity is None else intensity.astype(np.float32)
    return Scan(stamp_ns, points, times, intensity32)


def _record_type(fields: tuple[tuple[str, int, int, int], ...], order: str, point_step: int) -> np.dtype[np.void]:
    """The record of one point: x, y, z and, where they exist, time and intensity; other fields are padding."""
    by_name = {name.lower(): (name, offset, datatype, count) for name, offset, datatype, count in reversed(fields)}
    wanted = {axis: axis for axis in "xyz"}
    for role, names in (("time", TIME_FIELDS), ("intensity", INTENSITY_FIELDS)):
        if found := next((name for name in names if name in by_name), None):
            wanted[role] = found
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
    """The message's bytes as records, `(N,)` or `(height, width)` where rows are padded; nothing is copied."""
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
    if row_step == packed:
        return np.ndarray((height * width,), layout, np.ascontiguousarray(cloud.data).data)
    return np.ndarray((height, width), layout, np.ascontiguousarray(cloud.data).data, strides=(row_step, step))


def _compact(records: Records, returns: NDArray[np.bool_]) -> Records:
    """The records `(M,)` of the returns."""
    if records.ndim == 1 and returns.all():
        return records
    # As plain bytes: NumPy moves a record of unnamed bytes at once, but a structured one field by field.
    plain = records.view(np.dtype((np.void, records.dtype.itemsize)))
    kept = plain.take(np.flatnonzero(returns)) if records.ndim == 1 else plain[returns]
    return kept.view(records.dtype)


def _column(records: Records, name: str) -> NDArray[Any] | None:
    names = records.dtype.names or ()
    return records[name] if name in names else None
