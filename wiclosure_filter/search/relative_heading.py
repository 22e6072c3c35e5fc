"""Relative heading alone: compasses tell how two robots are turned to each other, but not the radio where they are.

No pair can be pruned by that.  But places that look alike from opposite sides, as in a symmetric hall, are told apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, IntArray, PredictionKind, Trajectory


def compass_yaw(alignment: FrameAlignment, max_sigma_rad: float) -> tuple[float, float] | None:
    """Yaw of b's odometry frame in that of a and its standard deviation, rad, where compasses tell it.

    Where different alignments are likely, the standard deviation covers how far they disagree; None where it exceeds
    `max_sigma_rad`, or without compasses.
    """
    if alignment.best is None or alignment.covariance is None or alignment.heading_knowledge != "heading":
        return None
    variance = float(alignment.covariance[2, 2])
    if alignment.best_alternative is not None:
        variance += float(se3.yaw(se3.between(alignment.best.T_a_b, alignment.best_alternative.T_a_b))) ** 2
    if variance > max_sigma_rad**2:
        return None
    return float(se3.yaw(alignment.best.T_a_b)), float(np.sqrt(variance))


@dataclass(frozen=True, eq=False)
class RelativeHeading:
    """Predicts rotations only; of the position, that scans which overlap lie within the sensor's range of each other.

    Implements `wiclosure.types.RelativePosePredictor`.

    Args:
        trajectories: keyframes of both robots.
        yaw_rad: of b's odometry frame in that of a.
        yaw_sigma_rad: its standard deviation.
        tilt_sigma_rad: of one odometry frame in the other.
        sensor_range_m: distance up to which two scans overlap.
        height_sigma_m: of the robots' difference in height.
    """

    trajectories: Mapping[str, Trajectory]
    yaw_rad: float
    yaw_sigma_rad: float
    tilt_sigma_rad: float
    sensor_range_m: float
    height_sigma_m: float
    kind: ClassVar[PredictionKind] = PredictionKind.HEADING

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """`T_a_b (M, 4, 4)` without displacement, and covariances `(M, 6, 6)`."""
        a, b = self.trajectories[robot_a], self.trajectories[robot_b]
        T_a_b = np.broadcast_to(np.eye(4), (len(index_a), 4, 4)).copy()
        R_odom_odom = se3.from_yaw(self.yaw_rad, np.zeros(3))[:3, :3]
        T_a_b[:, :3, :3] = np.swapaxes(a.poses[index_a, :3, :3], 1, 2) @ R_odom_odom @ b.poses[index_b, :3, :3]
        tilt, reach = self.tilt_sigma_rad, self.sensor_range_m / 2  # of a disc, the standard deviation along an axis
        known = np.square([tilt, tilt, self.yaw_sigma_rad, reach, reach, self.height_sigma_m])
        drift = sum(
            t.relative_covariance(np.zeros_like(index), index)[:, :3, :3] for t, index in ((a, index_a), (b, index_b))
        )
        covariance = np.broadcast_to(np.diag(known), (len(index_a), 6, 6)).copy()
        covariance[:, :3, :3] += drift
        return T_a_b, covariance
