"""Candidates for loop closures within one robot's own trajectory (DiSCo-SLAM's second stage)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from scipy import stats

from wiclosure.frontends.config import IntraRobotLoopSettings
from wiclosure.types import CandidatePairs, FloatArray, IntArray, PredictionKind, Trajectory

_ROWS_AT_ONCE = 256
MOST_KEYFRAMES = 4000  # of a robot that are compared with each other; of more, every second, third ...


class OdometryPredictor:
    """Predicts where a robot was relative to where it is by its odometry, whose drift says how sure that is."""

    kind: ClassVar[PredictionKind] = PredictionKind.POSE

    def __init__(self, keyframes: Trajectory) -> None:
        self._keyframes = keyframes

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """`T_a_b (M, 4, 4)` and covariances `(M, 6, 6)`; both robots are the one of the keyframes."""
        return self._keyframes.relative_pose(index_a, index_b), self._keyframes.relative_covariance(index_a, index_b)


def intra_robot_loops(keyframes: Trajectory, settings: IntraRobotLoopSettings) -> CandidatePairs:
    """Pairs of keyframes between which the robot travelled far enough, and which odometry cannot tell to be far apart.

    The later keyframe is `index_b`.  The work does not grow beyond that for `MOST_KEYFRAMES`.
    """
    chosen = np.arange(0, len(keyframes), -(-len(keyframes) // MOST_KEYFRAMES))
    kept = [
        _near(keyframes, chosen[start : start + _ROWS_AT_ONCE], chosen, settings)
        for start in range(0, len(chosen), _ROWS_AT_ONCE)
    ]
    index_a, index_b = (np.concatenate([pair[side] for pair in kept]) for side in (0, 1))
    unknown = np.full(len(index_a), np.nan)
    robot = keyframes.robot
    return CandidatePairs(robot, robot, index_a, index_b, unknown, unknown, OdometryPredictor(keyframes))


def _near(
    keyframes: Trajectory, rows: IntArray, chosen: IntArray, settings: IntraRobotLoopSettings
) -> tuple[IntArray, IntArray]:
    travelled = keyframes.distance[None, chosen] - keyframes.distance[rows, None]
    a, b = np.nonzero(travelled >= settings.min_travel_m)
    a, b = rows[a], chosen[b]
    apart_m = np.linalg.norm(keyframes.positions[a] - keyframes.positions[b], axis=1)
    variance = keyframes.translation_variance_between(a, b)
    gate = np.sqrt(stats.chi2.ppf(settings.gate_probability, df=3))
    near = apart_m <= settings.radius_m + gate * np.sqrt(variance)
    return a[near], b[near]
