"""Livox's `CustomMsg`, of both drivers and both ROS versions: points with their times, decoded from the wire.

```
std_msgs/Header header          CustomPoint: uint32 offset_time (ns after timebase)
uint64 timebase                              float32 x, y, z
uint32 point_num                             uint8 reflectivity, tag, line
uint8 lidar_id, uint8[3] rsvd
CustomPoint[] points
```
Point by point through rosbags, a scan of 20,000 would take longer than odometry does.
"""

from __future__ import annotations

import logging
import struct

import numpy as np

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.pointcloud2 import are_returns
from wiclosure.pipeline.sources.messages.ros_types import Encoding
from wiclosure.pipeline.sources.messages.timed_scans import TimedScans
from wiclosure.types import Scan

logger = logging.getLogger(__name__)

LIVOX_TYPES = (
    "livox_ros_driver/msg/CustomMsg",
    "livox_ros_driver2/msg/CustomMsg",
    "livox_interfaces/msg/CustomMsg",
    "livox_interfaces2/msg/CustomMsg",
)

LIVOX_POINT = np.dtype(
    {
        "names": ["offset_time", "x", "y", "z", "reflectivity"],
        "formats": ["<u4", "<f4", "<f4", "<f4", "u1"],
        "offsets": [0, 4, 8, 12, 16],
        "itemsize": 19,
    }
)
_FIXED = struct.Struct("<QIB3x")  # timebase, point_num, lidar_id


class LivoxDecoder:
    """Decodes the messages of one topic.

    Args:
        place: what is read, for the log.
    """

    def __init__(self, place: str = "") -> None:
        self._place, self._scan = place, TimedScans(place, ns_per_unit=1)
        self._is_untimed_said = False

    def decode(self, raw: bytes, encoding: Encoding, stamp_ns: int) -> Scan:
        """The returns of one serialised message.

        Raises:
            InputError: the message is shorter than it says.
        """
        try:
            points = _ros1_points(raw) if encoding == "ros1" else _cdr_points(raw)
        except (struct.error, ValueError) as error:
            raise InputError(f"no Livox message: {error}") from error
        returns = points[are_returns(points["x"], points["y"], points["z"])]
        positions = np.empty((len(returns), 3))
        for column, axis in enumerate("xyz"):
            positions[:, column] = returns[axis]
        times = returns["offset_time"].astype(np.int64)
        if len(times) > 1 and times.min() == times.max() and not self._is_untimed_said:
            logger.warning("%s: offset_time is the same for all points: the scans are not deskewed", self._place)
            self._is_untimed_said = True
        return self._scan(stamp_ns, positions, times, returns["reflectivity"])


def livox_header(raw: bytes, encoding: Encoding) -> tuple[int, str]:
    """Stamp in nanoseconds, and frame, of a serialised message.

    Raises:
        InputError: the message is shorter than it says.
    """
    try:
        seconds, nanoseconds, length = struct.unpack_from("<III", raw, 4)
    except struct.error as error:
        raise InputError(f"no Livox message: {error}") from error
    frame = raw[16 : 16 + length].rstrip(b"\0").decode(errors="replace")
    return seconds * 10**9 + nanoseconds, frame


def _ros1_points(raw: bytes) -> np.ndarray:
    """Points `(N,)` of a ROS 1 message, where all follows without gaps."""
    (length,) = struct.unpack_from("<I", raw, 12)
    start = 16 + length
    _FIXED.unpack_from(raw, start)
    (count,) = struct.unpack_from("<I", raw, start + _FIXED.size)
    return _points(raw, start + _FIXED.size + 4, count, LIVOX_POINT.itemsize)


def _cdr_points(raw: bytes) -> np.ndarray:
    """Points `(N,)` of a ROS 2 message: little endian CDR, each number aligned to its size after the first 4 bytes."""
    if raw[:2] != b"\0\1":
        raise ValueError(f"encapsulation {raw[:2].hex()} is not little endian CDR")
    (length,) = struct.unpack_from("<I", raw, 12)
    start = 4 + -(-(12 + length) // 8) * 8
    _FIXED.unpack_from(raw, start)
    (count,) = struct.unpack_from("<I", raw, start + _FIXED.size)
    return _points(raw, start + _FIXED.size + 4, count, 20)  # each point starts at a multiple of four


def _points(raw: bytes, start: int, count: int, step: int) -> np.ndarray:
    needed = count * step - (step - LIVOX_POINT.itemsize) if count else 0
    if start + needed > len(raw):
        raise ValueError(f"{count} points are announced, {max(len(raw) - start, 0)} bytes of {needed} there")
    return np.ndarray((count,), LIVOX_POINT, raw, start, (step,))
