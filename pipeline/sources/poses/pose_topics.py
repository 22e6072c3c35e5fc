"""Poses from topics of a bag: odometry, motion capture, transforms."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple, Protocol, TypeAlias, cast

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.plausible import LONGEST_QUATERNION, plausible_path
from wiclosure.pipeline.sources.bag import Bag, topic_name
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.messages.headers import HeaderMessage, nanoseconds_of, usual_fields
from wiclosure.pipeline.sources.poses.frames import TF_TYPES, TransformStamped, frame_name
from wiclosure.pipeline.sources.stamps import Stamped, mended
from wiclosure.types import Trajectory

logger = logging.getLogger(__name__)

ODOMETRY_TYPE = "nav_msgs/msg/Odometry"

_PoseRow: TypeAlias = tuple[int, list[float], str, str]
"""Stamp in nanoseconds; x, y, z, qx, qy, qz, qw; frame; child frame (empty where the message has none)."""


class _Received(NamedTuple):
    """A pose with its time of reception, and its two frames' names without slashes."""

    received_ns: int
    stamp_ns: int
    pose: list[float]
    frames: tuple[str, str]


class PoseTopic(NamedTuple):
    """What a topic says: `T_frame_body`, and the body's frame (empty where the messages name none)."""

    trajectory: Trajectory
    body_frame: str


class _Vector(Protocol):
    x: float
    y: float
    z: float


class _Quaternion(_Vector, Protocol):
    w: float


class _Pose(Protocol):
    position: _Vector
    orientation: _Quaternion


class _WithPose(Protocol):
    @property
    def header(self) -> HeaderMessage: ...

    pose: _Pose


class _PoseInside(Protocol):
    pose: _Pose


class _WithCovariance(Protocol):
    @property
    def header(self) -> HeaderMessage: ...

    pose: _PoseInside


class _Odometry(_WithCovariance, Protocol):
    child_frame_id: str


class _Path(Protocol):
    poses: list[_WithPose]


class _Transforms(Protocol):
    transforms: list[TransformStamped]


def _numbers(position: _Vector, orientation: _Quaternion) -> list[float]:
    p, q = position, orientation
    return [float(number) for number in (p.x, p.y, p.z, q.x, q.y, q.z, q.w)]


def _of_odometry(message: object) -> Iterator[_PoseRow]:
    m = cast("_Odometry", message)
    numbers = _numbers(m.pose.pose.position, m.pose.pose.orientation)
    yield nanoseconds_of(m.header.stamp), numbers, m.header.frame_id, m.child_frame_id


def _of_pose(message: object) -> Iterator[_PoseRow]:
    m = cast("_WithPose", message)
    yield nanoseconds_of(m.header.stamp), _numbers(m.pose.position, m.pose.orientation), m.header.frame_id, ""


def _of_pose_with_covariance(message: object) -> Iterator[_PoseRow]:
    m = cast("_WithCovariance", message)
    yield nanoseconds_of(m.header.stamp), _numbers(m.pose.pose.position, m.pose.pose.orientation), m.header.frame_id, ""


def _of_path(message: object) -> Iterator[_PoseRow]:
    for pose in cast("_Path", message).poses:
        yield from _of_pose(pose)


def _of_transform(message: object) -> Iterator[_PoseRow]:
    m = cast("TransformStamped", message)
    numbers = _numbers(m.transform.translation, m.transform.rotation)
    yield nanoseconds_of(m.header.stamp), numbers, m.header.frame_id, m.child_frame_id


def _of_transforms(message: object) -> Iterator[_PoseRow]:
    for transform in cast("_Transforms", message).transforms:
        yield from _of_transform(transform)


_PATH_TYPE = "nav_msgs/msg/Path"
POSE_TYPES: Mapping[str, Callable[[object], Iterator[_PoseRow]]] = {
    ODOMETRY_TYPE: _of_odometry,
    "geometry_msgs/msg/PoseStamped": _of_pose,
    "geometry_msgs/msg/PoseWithCovarianceStamped": _of_pose_with_covariance,
    "geometry_msgs/msg/TransformStamped": _of_transform,
    _PATH_TYPE: _of_path,
    **dict.fromkeys(TF_TYPES, _of_transforms),
}


def read_pose_topic(path: Path, topic: str, robot: str, *, salvage: bool = False) -> PoseTopic:
    """`T_frame_body` of every message; what holds no pose, and stray stamps, are left out and counted.

    Args:
        path: the bag.
        topic: its name; for transforms, with the two frames after it where there are several: `/tf odom->base_link`.
        robot: name that the trajectory carries.
        salvage: use what can be read of a damaged bag.

    Raises:
        InputError: no such topic, of another type, without messages, or without one proper pose.
    """
    name, frames = _topic_and_frames(topic)
    with open_bag(path, salvage=salvage) as bag:
        found = _topic_of_poses(bag, name)
        read = POSE_TYPES[bag.topics[found].msgtype]
        messages = list(bag.messages(found))
        of_path = bag.topics[found].msgtype == _PATH_TYPE
        if of_path:
            messages = messages[-1:]  # each holds all poses up to its time
        with usual_fields(f"{path}, topic {found}"):
            rows = [
                _Received(row[0] if of_path else received_ns, row[0], row[1], (frame_name(row[2]), frame_name(row[3])))
                for received_ns, message in messages
                for row in read(message)
            ]
    if not rows:
        raise InputError(f"{path}: topic {found} holds no messages; name another, or leave the odometry to KISS-ICP")
    rows = _of_one_body(rows, frames, f"{path}, topic {found}")
    return PoseTopic(_trajectory(rows, robot, f"{path}, topic {found}"), rows[0].frames[1])


def only_pose_topic(path: Path, *, salvage: bool = False) -> str:
    """The only topic of a bag that holds poses; transforms count where nothing else does.

    Raises:
        InputError: there is none, or there are several.
    """
    with open_bag(path, salvage=salvage) as bag:
        topics = [t for t in bag.topics.values() if t.is_ros and t.msgtype in POSE_TYPES and t.count]
    chosen = [t for t in topics if t.msgtype not in TF_TYPES] or [t for t in topics if not t.name.endswith("_static")]
    if len(chosen) != 1:
        names = ", ".join(f"{t.name} ({t.msgtype})" for t in chosen) or "none"
        raise InputError(f"{path}: name the topic of the poses; there are: {names}")
    return chosen[0].name


def _topic_and_frames(topic: str) -> tuple[str, tuple[str, str] | None]:
    name, _, frames = topic.partition(" ")
    parent, arrow, child = frames.partition("->")
    return name, (frame_name(parent.strip()), frame_name(child.strip())) if arrow else None


def _topic_of_poses(bag: Bag, topic: str) -> str:
    name = topic_name(bag.topics, topic)
    if name not in bag.topics:
        known = [f"{t.name} ({t.msgtype})" for t in bag.topics.values() if t.msgtype in POSE_TYPES and t.is_ros]
        raise InputError(f"{bag.path} has no topic {topic}; its topics of poses: {', '.join(known) or 'none'}")
    if bag.topics[name].msgtype not in POSE_TYPES:
        raise InputError(
            f"topic {name} of {bag.path} is {bag.topics[name].msgtype}; expected one of {', '.join(POSE_TYPES)}"
        )
    return name


def _of_one_body(rows: list[_Received], frames: tuple[str, str] | None, place: str) -> list[_Received]:
    """The poses of one body in one frame."""
    pairs = dict.fromkeys(row.frames for row in rows)
    several = ", ".join(f"{parent}->{child}" for parent, child in pairs)
    if frames is None and len({child for _, child in pairs}) > 1:
        raise InputError(
            f"{place} holds several transforms: {several}; name one after the topic, as '/tf odom->base_link'"
        )
    if frames is not None and frames not in pairs:
        raise InputError(f"{place} has no transform {'->'.join(frames)}; it has {several}")
    wanted = frames or next(iter(pairs))
    kept = [row for row in rows if row.frames == wanted]
    if (others := len(rows) - len(kept)) and frames is None:
        logger.warning("%s: %d poses are in another frame than %s and were left out", place, others, wanted[0])
    return kept


def _trajectory(rows: list[_Received], robot: str, place: str) -> Trajectory:
    """The poses that are some, at stamps that increase (see `wiclosure.pipeline.sources.stamps`)."""
    good = [row for row in rows if np.isfinite(row.pose).all() and _is_quaternion(row.pose[3:])]
    if not good:
        raise InputError(
            f"{place}: none of {len(rows)} messages holds a pose; positions or orientations are no numbers"
        )
    if len(good) < len(rows):
        logger.warning("%s: %d of %d messages hold no pose and were left out", place, len(rows) - len(good), len(rows))
    stamped = list(mended((Stamped(row.stamp_ns, row.received_ns, row.pose) for row in good), place))
    numbers = np.array([pose for _, pose in stamped])
    rotation = Rotation.from_quat(numbers[:, 3:]).as_matrix()
    stamps_ns = np.array([stamp_ns for stamp_ns, _ in stamped], np.int64)
    near = plausible_path(place, stamps_ns, numbers[:, :3])
    poses = se3.from_rotation_translation(rotation[near], numbers[near, :3])
    return Trajectory(robot, stamps_ns[near], poses)


def _is_quaternion(numbers: list[float]) -> bool:
    """Whether four finite numbers can be made one of length one."""
    return 1e-9 < max(map(abs, numbers)) < LONGEST_QUATERNION
