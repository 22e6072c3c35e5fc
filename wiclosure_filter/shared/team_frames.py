"""First guess of how all robots' odometry frames lie, from the alignments of pairs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment
from wiclosure.wiclosure_filter.shared.joint_factors import ANCHOR_SIGMA


def frames_from(robots: Sequence[str], alignments: Sequence[FrameAlignment]) -> dict[str, FloatArray]:
    """`T_world_odom` of every robot that the alignments join to the first of `robots`, in order of joining."""
    known = {robots[0]: np.eye(4)}
    grown = True
    while grown:
        grown = False
        for alignment in alignments:
            if alignment.best is None or (alignment.robot_a in known) == (alignment.robot_b in known):
                continue
            if alignment.robot_a in known:
                known[alignment.robot_b] = known[alignment.robot_a] @ alignment.best.T_a_b
            else:
                known[alignment.robot_a] = known[alignment.robot_b] @ se3.inverse(alignment.best.T_a_b)
            grown = True
    return {robot: known[robot] for robot in robots if robot in known}


def settled(
    frames: Mapping[str, FloatArray], alignments: Sequence[FrameAlignment], robust_threshold: float
) -> dict[str, FloatArray]:
    """The same frames where several ways lead from one to another: a pose graph of frames and alignments.

    Along a chain of alignments errors add up; of a large team the far frames would be hundreds of metres off, and the
    joint estimate would take many more steps from there.

    Args:
        frames: `T_world_odom` of each robot; the first one stays.
        alignments: certain ones, between these robots.
        robust_threshold: of the Cauchy kernel, in standard deviations.
    """
    if len(alignments) < len(frames):
        return dict(frames)  # one way only
    number = {robot: n for n, robot in enumerate(frames)}
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for robot, T_world_odom in frames.items():
        values.insert(number[robot], gtsam.Pose3(T_world_odom))
    graph.add(gtsam.PriorFactorPose3(0, values.atPose3(0), gtsam.noiseModel.Isotropic.Sigma(6, ANCHOR_SIGMA)))
    kernel = gtsam.noiseModel.mEstimator.Cauchy(robust_threshold)
    for alignment in alignments:
        assert alignment.best is not None  # they are certain
        assert alignment.covariance is not None
        noise = gtsam.noiseModel.Gaussian.Covariance(alignment.covariance + ANCHOR_SIGMA**2 * np.eye(6))
        keys = number[alignment.robot_a], number[alignment.robot_b]
        measured = gtsam.Pose3(alignment.best.T_a_b)
        graph.add(gtsam.BetweenFactorPose3(*keys, measured, gtsam.noiseModel.Robust(kernel, noise)))
    found = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    return {robot: found.atPose3(n).matrix() for robot, n in number.items()}
