"""Reads the odometry that a robot brings along, from a file or a topic of a bag."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.trajectories.trajectory_file import read_trajectory
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.runtime.paths import exists
from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.poses.frames import StaticTransforms
from wiclosure.pipeline.sources.poses.mounting import LidarMount, lidar_mount
from wiclosure.pipeline.sources.poses.pose_topics import PoseTopic, only_pose_topic, read_pose_topic
from wiclosure.types import FloatArray, Trajectory

logger = logging.getLogger(__name__)

_FAR_M = 10_000.0  # beyond, float32 clouds lose millimetres, and maps their voxels
_GRID_M = 1_000.0  # origins are round numbers


def read_recorded_odometry(robot: str, recording: RobotRecording, *, salvage: bool = False) -> Trajectory | None:
    """`T_odom_lidar` in the robot's own clock, or None where it brings none.

    Raises:
        InputError: it cannot be read, or a topic is named and there is no bag.
    """
    if recording.odometry is None and recording.odometry_topic is None:
        return None
    read = read_poses(robot, recording, recording.odometry, recording.odometry_topic, salvage=salvage)
    T_body_lidar = _lidar_in_body(robot, recording, read.body_frame, salvage=salvage)
    if T_body_lidar is None:
        return read.trajectory
    return Trajectory(robot, read.trajectory.stamps_ns, read.trajectory.poses @ T_body_lidar)


def read_poses(
    robot: str, recording: RobotRecording, path: Path | None, topic: str | None, *, salvage: bool = False
) -> PoseTopic:
    """Poses from a file, or from a topic of the bag at `path`, or of the scans' bag where there is none.

    Raises:
        InputError: they cannot be read, or a topic is named and there is no bag.
    """
    place = recording.scans if path is None else path
    if path is not None and not exists(path):
        raise InputError(f"{path} does not exist; paths are relative to the data set file")
    if bag_kind(place):
        return read_pose_topic(place, topic or only_pose_topic(place, salvage=salvage), robot, salvage=salvage)
    if path is None:
        raise InputError(f"{place} is no bag, so it has no topic {topic}; name a TUM file, or a bag beside the topic")
    return PoseTopic(read_trajectory(path, robot), "")


def near_origin(trajectory: Trajectory) -> tuple[Trajectory, tuple[float, float, float]]:
    """The trajectory in a frame that begins near it, and that frame's origin; the same where it begins near already.

    Odometry may start anywhere (UTM counts thousands of kilometres), but maps and float32 clouds need small numbers.
    """
    first = trajectory.positions[0]
    if np.abs(first).max() <= _FAR_M:
        return trajectory, (0.0, 0.0, 0.0)
    x, y, z = (np.rint(first / _GRID_M) * _GRID_M).tolist()
    T_local_odom = np.eye(4)
    T_local_odom[:3, 3] = -x, -y, -z
    return trajectory.moved(T_local_odom), (x, y, z)


def _say_no_child(robot: str, recording: RobotRecording, *, salvage: bool) -> None:
    """Static transforms that cannot be used because poses in a bag do not say of what they are."""
    place = recording.odometry or recording.scans
    if not bag_kind(place):
        return
    with open_bag(recording.scans, salvage=salvage) as bag:
        transforms = len(StaticTransforms.of(bag))
    if transforms:
        logger.warning(
            "%s: the messages of its odometry name no child frame, so the %d static transforms of the bag cannot say"
            " where the LiDAR is in its axes; they are taken for one: set lidar_pose if they are not",
            robot, transforms,
        )  # fmt: skip


def _lidar_in_body(robot: str, recording: RobotRecording, body_frame: str, *, salvage: bool) -> FloatArray | None:
    """`T_body_lidar` as the data set states it, or by the static transforms in the bags."""
    if recording.lidar_pose is not None:
        position, quat_xyzw = np.array(recording.lidar_pose[:3]), recording.lidar_pose[3:]
        return se3.from_rotation_translation(Rotation.from_quat(quat_xyzw).as_matrix(), position)
    if not bag_kind(recording.scans):
        return None
    if not body_frame:
        _say_no_child(robot, recording, salvage=salvage)
        return None
    mount: LidarMount = lidar_mount(recording.scans, recording.topic, body_frame, recording.odometry, salvage=salvage)
    if mount.frame == body_frame:
        return None
    if mount.T_body_lidar is not None:
        logger.warning("%s: /tf_static says where the LiDAR (%s) is in %s; used", robot, mount.frame, body_frame)
    elif mount.frame:
        logger.warning(
            "%s: its odometry tells the path of %s, its clouds are in %s, and no static transform connects the two;"
            " they are taken for one: set lidar_pose if they are not", robot, body_frame, mount.frame,
        )  # fmt: skip
    return mount.T_body_lidar
