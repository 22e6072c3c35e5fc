"""The factors of the joint estimate: odometry, gravity, ranges, bearings, headings (GTSAM)."""

from __future__ import annotations

from collections.abc import Mapping

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.shared.graph_nodes import GraphNodes
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

# Sigmas of what nothing is known of, small enough for well-conditioned equations.
UNKNOWN_M, UNKNOWN_RAD, ANCHOR_SIGMA = 1e4, 3.0, 1e-4


def add_first_guess(initial: gtsam.Values, first: int, nodes: GraphNodes, T_world_odom: FloatArray) -> None:
    """Poses of one robot's nodes as odometry has them."""
    T_odom_node = se3.from_rotation_translation(np.broadcast_to(np.eye(3), (len(nodes), 3, 3)), nodes.position)
    for number, T_world_node in enumerate(T_world_odom @ T_odom_node):
        initial.insert(first + number, gtsam.Pose3(T_world_node))


def odometry_factors(nodes: Mapping[str, GraphNodes], first: Mapping[str, int]) -> gtsam.NonlinearFactorGraph:
    """Between neighbouring nodes of each robot; `first` is the key of its first node."""
    graph = gtsam.NonlinearFactorGraph()
    for robot, own in nodes.items():
        for key, (step, covariance) in enumerate(zip(*own.steps(), strict=True), first[robot]):
            noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
            graph.add(gtsam.BetweenFactorPose3(key, key + 1, gtsam.Pose3(gtsam.Rot3(), step), noise))
    return graph


def frame_prior(initial: gtsam.Values, key: int, anchor: bool, settings: FilterSettings) -> gtsam.NonlinearFactor:
    """Holds the first robot; of the others only what gravity and the ground tell: tilt, and roughly the height."""
    sigmas = np.full(6, ANCHOR_SIGMA) if anchor else level_sigmas(settings)
    return gtsam.PriorFactorPose3(key, initial.atPose3(key), gtsam.noiseModel.Diagonal.Sigmas(sigmas))


def level_sigmas(settings: FilterSettings) -> FloatArray:
    """`(6,)` of an odometry frame in another before anything is measured: tilt and height, hardly more."""
    alignment, shared = settings.alignment, settings.shared_trajectory
    tilt = np.sqrt(2.0) * shared.gravity_sigma_rad if alignment.gravity_aligned else alignment.tilt_sigma_rad
    return np.array([tilt, tilt, UNKNOWN_RAD, UNKNOWN_M, UNKNOWN_M, alignment.height_sigma_m])


def add_links(
    graph: gtsam.NonlinearFactorGraph, kept: KeptLinks, key_a: IntArray, key_b: IntArray, settings: FilterSettings
) -> None:
    """Ranges, bearings and headings as separate factors: a false range does not spoil a true bearing."""
    kernel = gtsam.noiseModel.mEstimator.Cauchy(settings.shared_trajectory.robust_threshold)
    links = kept.links
    with_yaw = int(np.isfinite(links.yaw).sum())
    for row in range(len(kept)):
        a, b = int(key_a[row]), int(key_b[row])
        receiver, transmitter = (a, b) if links.a_receives[row] else (b, a)
        if np.isfinite(links.range_m[row]):
            sigma = links.range_sigma_m[row]
            robust = gtsam.noiseModel.Robust(kernel, gtsam.noiseModel.Isotropic.Sigma(1, sigma))
            graph.add(gtsam.RangeFactorPose3(receiver, transmitter, links.range_m[row], robust))
        if np.isfinite(kept.direction[row]).all():
            graph.add(_bearing(receiver, transmitter, kept.direction[row], kept.direction_covariance[row], kernel))
        if np.isfinite(links.yaw[row]):
            # A compass errs by its surroundings, not anew at each reading: together they count as one.
            sigma = links.yaw_sigma[row] * np.sqrt(with_yaw)
            sigmas = np.array([UNKNOWN_RAD, UNKNOWN_RAD, sigma, UNKNOWN_M, UNKNOWN_M, UNKNOWN_M])
            robust = gtsam.noiseModel.Robust(kernel, gtsam.noiseModel.Diagonal.Sigmas(sigmas))
            measured = gtsam.Pose3(gtsam.Rot3.Rz(links.yaw[row]), np.zeros(3))
            graph.add(gtsam.BetweenFactorPose3(a, b, measured, robust))


def _bearing(
    receiver: int,
    transmitter: int,
    direction: FloatArray,
    covariance: FloatArray,
    kernel: gtsam.noiseModel.mEstimator.Base,
) -> gtsam.NonlinearFactor:
    """GTSAM knows bearings to poses only together with ranges: the range gets no weight."""
    unit = gtsam.Unit3(direction)
    noise = np.diag([0.0, 0.0, UNKNOWN_M**2])
    noise[:2, :2] = unit.basis().T @ covariance @ unit.basis()
    robust = gtsam.noiseModel.Robust(kernel, gtsam.noiseModel.Gaussian.Covariance(noise))
    return gtsam.BearingRangeFactorPose3(receiver, transmitter, unit, 0.0, robust)
