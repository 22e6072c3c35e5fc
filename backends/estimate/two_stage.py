"""DiSCo-SLAM's way: one rigid transform for each pair of robots, then a graph whose nodes are the robots.

Huang et al., "DiSCo-SLAM", RA-L 2022, the first two of its optimisations; the third, inside each robot's own SLAM, is
replaced by the joint estimate (`optimiser: joint`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.backends.closure_sets import ClosureSet
from wiclosure.backends.config import PoseGraphSettings
from wiclosure.backends.estimate.frames import components, frame_estimates, frame_transform, initial_frames
from wiclosure.backends.factor_graph.earth_factors import upright
from wiclosure.backends.factor_graph.factors import anchor, inliers_among, least_squares, prior
from wiclosure.types import BoolArray, EarthMeasurements, FloatArray, Trajectory

EQUAL_WEIGHT = np.ones(6)  # every pair of robots counts the same between them, as in DiSCo-SLAM


def placed_in_two_stages(
    trajectories: Mapping[str, Trajectory],
    sets: Sequence[ClosureSet],
    settings: PoseGraphSettings,
    earth: EarthMeasurements,
) -> tuple[list[BoolArray], dict[str, FloatArray]]:
    """Inliers (one mask a set) and `T_world_odom` by robot; frames of robots that know up stay upright.

    Closures within one robot do not take part: they are kept and change nothing.
    """
    masks: list[BoolArray] = []
    kept: list[ClosureSet] = []
    transforms: list[FloatArray] = []
    for closure_set in sets:
        mask, T_a_b = (
            _pair(closure_set, trajectories, settings)
            if closure_set.between_robots
            else (np.ones(len(closure_set), bool), np.eye(4))
        )
        masks.append(mask)
        if closure_set.between_robots and mask.any():
            kept.append(closure_set.subset(np.flatnonzero(mask)))
            transforms.append(T_a_b)
    return masks, _robots(trajectories, kept, transforms, earth)


def _pair(
    closure_set: ClosureSet, trajectories: Mapping[str, Trajectory], settings: PoseGraphSettings
) -> tuple[BoolArray, FloatArray]:
    """First stage: `T_a_b` of two odometry frames; each closure measures it directly."""
    measured = frame_estimates(closure_set, trajectories)
    to_odom_b = se3.adjoint(trajectories[closure_set.robot_b].poses[closure_set.index_b])
    covariances = se3.rotate_covariance(to_odom_b, closure_set.covariance)
    factors = [prior(0, T, covariance) for T, covariance in zip(measured, covariances, strict=True)]
    start = frame_transform(closure_set, trajectories)
    values = gtsam.Values()
    values.insert(0, gtsam.Pose3(start))
    nothing_known = gtsam.NonlinearFactorGraph()
    nothing_known.add(anchor(0, gtsam.Pose3(start), loose=True))
    mask, estimate = inliers_among(factors, nothing_known, values, settings)
    return mask, np.asarray(estimate.atPose3(0).matrix())


def _robots(
    trajectories: Mapping[str, Trajectory],
    sets: Sequence[ClosureSet],
    transforms: Sequence[FloatArray],
    earth: EarthMeasurements,
) -> dict[str, FloatArray]:
    """Second stage: all odometry frames from the pairs' transforms."""
    robots = list(trajectories)
    frames = initial_frames(trajectories, sets)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for n, robot in enumerate(robots):
        values.insert(n, gtsam.Pose3(frames[robot]))
    for group in components(robots, sets):
        graph.add(anchor(robots.index(group[0]), gtsam.Pose3(frames[group[0]])))
    weight = gtsam.noiseModel.Diagonal.Sigmas(EQUAL_WEIGHT)
    for closure_set, T_a_b in zip(sets, transforms, strict=True):
        a, b = robots.index(closure_set.robot_a), robots.index(closure_set.robot_b)
        graph.add(gtsam.BetweenFactorPose3(a, b, gtsam.Pose3(T_a_b), weight))
    for robot, up in earth.up.items():
        graph.add(upright(robots.index(robot), up))
    solved = least_squares(graph, values)
    return {robot: np.asarray(solved.atPose3(n).matrix()) for n, robot in enumerate(robots)}
