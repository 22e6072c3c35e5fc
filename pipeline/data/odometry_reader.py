"""Reads the odometry that a robot brings along, from a TUM file or a topic of its bag."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.tum import read_tum
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.odometry_topic import read_odometry_topic
from wiclosure.types import Trajectory


def read_recorded_odometry(robot: str, recording: RobotRecording, *, salvage: bool = False) -> Trajectory | None:
    """`T_odom_lidar` in the robot's own clock, or None where it brings none.

    Raises:
        InputError: it cannot be read, or a topic is named and the recording is no bag.
    """
    if recording.odometry is not None:
        trajectory = read_tum(recording.odometry, robot)
    elif recording.odometry_topic is not None:
        if not bag_kind(recording.scans):
            raise InputError(f"{recording.scans} is no bag, so it has no odometry topic; name a TUM file as odometry")
        trajectory = read_odometry_topic(recording.scans, recording.odometry_topic, robot, salvage=salvage)
    else:
        return None
    if recording.lidar_pose is None:
        return trajectory
    position, quat_xyzw = np.array(recording.lidar_pose[:3]), recording.lidar_pose[3:]
    T_body_lidar = se3.from_rotation_translation(Rotation.from_quat(quat_xyzw).as_matrix(), position)
    return Trajectory(robot, trajectory.stamps_ns, trajectory.poses @ T_body_lidar)
