"""The one decoder of `sensor_msgs/PointCloud2`: any field layout in, `Scan` out.

The message's bytes are viewed in place as records.  Points that are no returns (NaN, infinite, at the origin) are found
on that view, the remaining records are taken whole, and only then are the fields copied out: a point and its time and
intensity stay together by construction.  This goes block by block, so that a block's bytes are read from memory once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.headers import HeaderMessage
from wiclosure.pipeline.sources.messages.point_times import PointClock, strays
from wiclosure.types import Float32Array, FloatArray, Scan

POINT_CLOUD_TYPE = "sensor_msgs/msg/PointCloud2"
TIME_FIELDS = ("t", "time", "timestamp", "time_stamp", "offset_time")
INTENSITY_FIELDS = ("intensity", "i", "reflectivity")

# sensor_msgs/PointField's numbers; 9 to 11 are new in ROS 2 Lyrical, and in use before that.
FORMATS: Mapping[int, str] = {
    1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8", 9: "i8", 10: "u8", 11: "u1"
}  # fmt: skip

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
        columns = _returns(_records(cloud, self._layout(cloud)))
        return timed_scan(self._clock, stamp_ns, *columns)

    def _layout(self, cloud: PointCloud2Message) -> np.dtype[np.void]:
        fields = tuple((field.name, field.offset, field.datatype, field.count) for field in cloud.fields)
        key = (fields, bool(cloud.is_bigendian), cloud.point_step)
        if key not in self._layouts:
            self._layouts[key] = _record_type(fields, ">" if cloud.is_bigendian else "<", cloud.point_step)
        return self._layouts[key]


def are_returns(x: NDArray[Any], y: NDArray[Any], z: NDArray[Any]) -> NDArray[np.bool_]:
    """Which points `(N,)` are finite and not at the origin, where drivers put beams without a return."""
    with np.errstate(over="ignore", invalid="ignore"):
        size = np.add(np.abs(x), np.abs(y))
        size = np.add(size, np.abs(z), out=size if size.dtype == np.result_type(size, z) else None)
    return np.asarray((size != 0) & (size < np.inf))  # the latter is false for NaN


def timed_scan(
    clock: PointClock,
    stamp_ns: int,
    points: FloatArray,
    raw_times: NDArray[Any] | None,
    intensity: NDArray[Any] | None = None,
) -> Scan:
    """A scan of returns `(N, 3)` with their recorded times, but for points whose time is not a number or a stray."""
    if raw_times is not None and len(raw_times) and not np.isfinite(raw_times.min() + raw_times.max()):
        timed = np.isfinite(raw_times)
        points, raw_times = (points[timed], raw_times[timed]) if timed.any() else (points, None)
        intensity = None if intensity is None or raw_times is None else intensity[timed]
    if raw_times is not None and (stray := strays(raw_times)).any():
        points, raw_times = points[~stray], raw_times[~stray]
        intensity = None if intensity is None else intensity[~stray]
    times = None if raw_times is None else clock.seconds_after(stamp_ns, raw_times)
    intensity32: Float32Array | None = None if intensity is None else intensity.astype(np.float32, copy=False)
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


def _returns(records: Records) -> tuple[FloatArray, NDArray[Any] | None, Float32Array | None]:
    """Points `(M, 3)`, times and intensity `(M,)` of the returns among the records."""
    names, count = records.dtype.names or (), len(records)
    points = np.empty((count, 3))
    times = np.empty(count, _wide(records.dtype["time"])) if "time" in names else None
    intensity = np.empty(count, np.float32) if "intensity" in names else None
    end = 0
    for start in range(0, count, _BLOCK):
        block = _kept(records[start : start + _BLOCK])
        here = slice(end, end + len(block))
        for column, name in enumerate("xyz"):
            points[here, column] = block[name]
        if times is not None:
            times[here] = block["time"]
        if intensity is not None:
            intensity[here] = block["intensity"]
        end = here.stop
    return points[:end], None if times is None else times[:end], None if intensity is None else intensity[:end]


def _kept(records: Records) -> Records:
    """The records that are returns."""
    returns = are_returns(records["x"], records["y"], records["z"])
    if returns.all():
        return records
    # As plain bytes: NumPy moves a record of unnamed bytes at once, but a structured one field by field.
    plain = records.view(np.dtype((np.void, records.dtype.itemsize)))
    return plain.take(np.flatnonzero(returns)).view(records.dtype)


def _wide(dtype: np.dtype[Any]) -> type[np.float64] | type[np.int64]:
    return np.float64 if dtype.kind == "f" else np.int64
