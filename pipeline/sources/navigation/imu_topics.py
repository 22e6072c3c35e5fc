"""`sensor_msgs/Imu` of a bag, many at once: an hour at 400 Hz is a million messages."""

from __future__ import annotations

import logging
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.bag import RawMessage
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.poses.frames import frame_name
from wiclosure.pipeline.sources.stamps import Stamped, mended
from wiclosure.types import FloatArray, ImuLog

logger = logging.getLogger(__name__)

IMU_TYPE = "sensor_msgs/msg/Imu"
# At the end of every message: orientation (4), turning rate (3) and acceleration (3), 9 of covariance each.
_NUMBERS = 37
_RATE, _ACCELERATION = slice(13, 16), slice(25, 28)
_STAMP = slice(4, 12)  # seconds and nanoseconds: after the sequence number of ROS 1, or the encoding of ROS 2
FASTEST_RAD_S, STRONGEST_M_S2 = 1e3, 1e4  # a thousand times what robots bear


class ImuReading(NamedTuple):
    """Samples in the IMU's axes, the name of these axes, and `T_lidar_imu (4, 4)` where the source tells it."""

    log: ImuLog
    frame: str = ""
    T_lidar_imu: FloatArray | None = None


def read_imu_topic(path: Path, topic: str, *, salvage: bool = False) -> ImuReading:
    """All samples of a topic; what holds no numbers, and stray stamps, are left out and counted.

    Args:
        path: the bag.
        topic: its name.
        salvage: use what can be read of a damaged bag.

    Raises:
        InputError: no such topic, of another type, or without one proper message.
    """
    with open_bag(path, salvage=salvage) as bag:
        name = bag.require_topic_of(IMU_TYPE, topic)
        messages = list(bag.read(name))
    return _samples(messages, f"{path}, topic {name}")


def _samples(messages: list[RawMessage], place: str) -> ImuReading:
    """Numbers are the last of a message, whatever comes before."""
    size = 8 * _NUMBERS
    whole = _of_one_frame([(received_ns, raw) for received_ns, raw in messages if len(raw) > size + 12], size, place)
    if not whole:
        raise InputError(f"{place}: none of {len(messages)} messages holds a sample; name another topic")
    big = whole[0][1][:4] == b"\x00\x00\x00\x00" and not _is_ros1(whole[0][1])
    order = ">" if big else "<"
    numbers = np.frombuffer(b"".join(raw[-size:] for _, raw in whole), f"{order}f8").reshape(-1, _NUMBERS)
    seconds = np.frombuffer(b"".join(raw[_STAMP] for _, raw in whole), f"{order}u4").reshape(-1, 2).astype(np.int64)
    stamps_ns = (seconds[:, 0] * 10**9 + seconds[:, 1]).tolist()
    # NaN is not below anything, either.
    good = (np.abs(numbers[:, _RATE]) < FASTEST_RAD_S).all(axis=1)
    good &= (np.abs(numbers[:, _ACCELERATION]) < STRONGEST_M_S2).all(axis=1)
    rows = np.flatnonzero(good).tolist()
    if bad := len(whole) - len(rows):
        logger.warning("%s: %d of %d messages hold no numbers and were left out", place, bad, len(whole))
    if not rows:
        raise InputError(f"{place}: none of {len(messages)} messages holds numbers; name another topic")
    kept = list(mended((Stamped(stamps_ns[row], whole[row][0], row) for row in rows), place))
    chosen = np.array([row for _, row in kept], np.int64)
    values = numbers[chosen].astype(np.float64)
    log = ImuLog(np.array([ns for ns, _ in kept], np.int64), values[:, _ACCELERATION], values[:, _RATE])
    return ImuReading(log, frame_name(_frame_of(whole[0][1], order)))


def _of_one_frame(messages: list[RawMessage], size: int, place: str) -> list[RawMessage]:
    """Those of the frame that most are in: several IMUs may share a topic."""
    headers = Counter(raw[12:-size] for _, raw in messages)  # the length of the frame's name, and the name
    if len(headers) < 2:
        return messages
    header, count = headers.most_common(1)[0]
    names = [one[4:].rstrip(b"\x00").decode(errors="replace") or "(none)" for one, _ in headers.most_common()]
    logger.warning(
        "%s has samples of the frames %s; only the %d of %s are used", place, ", ".join(names), count, names[0]
    )
    return [(received_ns, raw) for received_ns, raw in messages if raw[12:-size] == header]


def _is_ros1(raw: bytes) -> bool:
    """Whether a message has the length of ROS 1's: sequence, stamp, length of the frame's name, name, numbers."""
    return len(raw) == 16 + int.from_bytes(raw[12:16], "little") + 8 * _NUMBERS


def _frame_of(raw: bytes, order: str) -> str:
    length = int(np.frombuffer(raw[12:16], f"{order}u4")[0])
    return raw[16 : 16 + length].split(b"\x00")[0].decode(errors="replace")
