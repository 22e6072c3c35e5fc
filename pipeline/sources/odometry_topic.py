"""A robot's own odometry from `nav_msgs/Odometry` in its bag: wheels, LIO-SAM, FAST-LIO."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Protocol, cast

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.messages.headers import HeaderMessage
from wiclosure.pipeline.sources.messages.wireless_messages import nanoseconds_of
from wiclosure.types import Trajectory

logger = logging.getLogger(__name__)

ODOMETRY_TYPE = "nav_msgs/msg/Odometry"


class _Vector(Protocol):
    x: float
    y: float
    z: float


class _Quaternion(_Vector, Protocol):
    w: float


class _Pose(Protocol):
    position: _Vector
    orientation: _Quaternion


class _PoseWithCovariance(Protocol):
    pose: _Pose


class OdometryMessage(Protocol):
    """`nav_msgs/Odometry`, as rosbags makes it."""

    @property
    def header(self) -> HeaderMessage: ...  # noqa: D102  -- named by ROS

    pose: _PoseWithCovariance


def read_odometry_topic(path: Path, topic: str, robot: str, *, salvage: bool = False) -> Trajectory:
    """`T_odom_body` of every message whose stamp follows the one before; the others are left out and counted.

    Raises:
        InputError: no such topic, of another type, without messages, or a pose that is none.
    """
    with open_bag(path, salvage=salvage) as bag:
        if topic not in bag.topics:
            known = [t.name for t in bag.topics.values() if t.msgtype == ODOMETRY_TYPE]
            raise InputError(f"{path} has no topic {topic}; its odometry topics: {', '.join(known) or 'none'}")
        if bag.topics[topic].msgtype != ODOMETRY_TYPE:
            raise InputError(f"topic {topic} of {path} is {bag.topics[topic].msgtype}; expected {ODOMETRY_TYPE}")
        rows = [_row(cast("OdometryMessage", message)) for _, message in bag.messages(topic)]
    if not rows:
        raise InputError(f"{path}: topic {topic} holds no messages; name another, or leave the odometry to KISS-ICP")
    stamps_ns = np.array([stamp for stamp, _ in rows], np.int64)
    poses = np.array([pose for _, pose in rows])
    bad = ~np.isfinite(poses).all(axis=1) | (np.linalg.norm(poses[:, 3:], axis=1) < 1e-9)
    if bad.any():
        raise InputError(f"{path}, topic {topic}, message {int(bad.argmax())}: position or orientation is no pose")
    follows = stamps_ns > np.concatenate([[-1], np.maximum.accumulate(stamps_ns)[:-1]])
    if not follows.all():
        logger.warning("%s, topic %s: %d stamps repeat or go back; left out", path, topic, int((~follows).sum()))
    rotation = Rotation.from_quat(poses[follows, 3:]).as_matrix()
    return Trajectory(robot, stamps_ns[follows], se3.from_rotation_translation(rotation, poses[follows, :3]))


def _row(message: OdometryMessage) -> tuple[int, list[float]]:
    p, q = message.pose.pose.position, message.pose.pose.orientation
    return nanoseconds_of(message.header.stamp), [p.x, p.y, p.z, q.x, q.y, q.z, q.w]
