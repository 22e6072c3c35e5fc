"""The factors of the joint estimate: odometry, gravity, ranges, bearings, headings (GTSAM)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum, auto

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.likelihood.frame_prior import UNKNOWN_M, UNKNOWN_RAD, FramePrior
from wiclosure.wiclosure_filter.shared.graph_nodes import GraphNodes
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

ANCHOR_SIGMA = 1e-4  # rad, m: holds the first frame, and is small enough for well-conditioned equations


class Measured(Enum):
    """What a link tells."""

    RANGE = auto()
    BEARING = auto()
    HEADING = auto()


@dataclass(frozen=True, eq=False)
class JointFactors:
    """All factors of the joint estimate.

    Args:
        steps: between neighbouring nodes.
        links: of each pair of robots.
        others: on frames and heights.
    """

    steps: gtsam.NonlinearFactorGraph
    links: Mapping[tuple[str, str], gtsam.NonlinearFactorGraph]
    others: gtsam.NonlinearFactorGraph

    @property
    def graph(self) -> gtsam.NonlinearFactorGraph:
        """All of them."""
        graph = gtsam.NonlinearFactorGraph()
        for part in (self.steps, self.others, *self.links.values()):
            graph.push_back(part)
        return graph


def add_first_guess(initial: gtsam.Values, first: int, nodes: GraphNodes, T_world_odom: FloatArray) -> None:
    """Poses of one robot's nodes as odometry has them."""
    T_odom_node = se3.from_rotation_translation(np.broadcast_to(np.eye(3), (len(nodes), 3, 3)), nodes.position)
    for number, T_world_node in enumerate(T_world_odom @ T_odom_node):
        initial.insert(first + number, gtsam.Pose3(T_world_node))


def step_factors(nodes: Mapping[str, GraphNodes], first: Mapping[str, int]) -> gtsam.NonlinearFactorGraph:
    """Between neighbouring nodes of each robot; `first` is the key of its first node."""
    graph = gtsam.NonlinearFactorGraph()
    for robot, own in nodes.items():
        for key, (step, covariance) in enumerate(zip(*own.steps(), strict=True), first[robot]):
            noise = gtsam.noiseModel.Gaussian.Covariance(covariance)
            graph.add(gtsam.BetweenFactorPose3(key, key + 1, gtsam.Pose3(gtsam.Rot3(), step), noise))
    return graph


def frame_factors(initial: gtsam.Values, first: Mapping[str, int], prior: FramePrior) -> gtsam.NonlinearFactorGraph:
    """Holds the frame of the first robot; of the others, what is known of them before anything is measured."""
    graph = gtsam.NonlinearFactorGraph()
    for number, key in enumerate(first.values()):
        sigmas = np.full(6, ANCHOR_SIGMA) if number == 0 else prior.sigmas
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigmas)
        graph.add(gtsam.PriorFactorPose3(key, initial.atPose3(key), noise))
    return graph


def measured(kept: KeptLinks) -> Iterator[tuple[int, Measured]]:
    """Number of each link, and what it tells."""
    known = np.isfinite([kept.links.range_m, kept.direction.sum(axis=1), kept.links.yaw])
    for row, told in enumerate(known.T):
        yield from ((row, kind) for kind, there in zip(Measured, told, strict=True) if there)


def link_factors(
    kept: KeptLinks, key_a: IntArray, key_b: IntArray, robust_threshold: float
) -> gtsam.NonlinearFactorGraph:
    """Ranges, bearings and headings as separate factors: a false range does not spoil a true bearing.

    Args:
        kept: L links.
        key_a: `(L,)` keys of the nodes at a.
        key_b: those at b.
        robust_threshold: of the Cauchy kernel, in standard deviations.
    """
    graph = gtsam.NonlinearFactorGraph()
    kernel = gtsam.noiseModel.mEstimator.Cauchy(robust_threshold)
    links = kept.links
    with_yaw = int(np.isfinite(links.yaw).sum())
    for row, kind in measured(kept):
        a, b = int(key_a[row]), int(key_b[row])
        receiver, transmitter = (a, b) if links.a_receives[row] else (b, a)
        if kind is Measured.RANGE:
            sigma = links.range_sigma_m[row]
            robust = gtsam.noiseModel.Robust(kernel, gtsam.noiseModel.Isotropic.Sigma(1, sigma))
            graph.add(gtsam.RangeFactorPose3(receiver, transmitter, links.range_m[row], robust))
        elif kind is Measured.BEARING:
            graph.add(_bearing(receiver, transmitter, kept.direction[row], kept.direction_covariance[row], kernel))
        else:
            # A compass errs by its surroundings, not anew at each reading: together they count as one.
            sigma = links.yaw_sigma[row] * np.sqrt(with_yaw)
            sigmas = np.array([UNKNOWN_RAD, UNKNOWN_RAD, sigma, UNKNOWN_M, UNKNOWN_M, UNKNOWN_M])
            robust = gtsam.noiseModel.Robust(kernel, gtsam.noiseModel.Diagonal.Sigmas(sigmas))
            heading = gtsam.Pose3(gtsam.Rot3.Rz(links.yaw[row]), np.zeros(3))
            graph.add(gtsam.BetweenFactorPose3(a, b, heading, robust))
    return graph


def add_height(graph: gtsam.NonlinearFactorGraph, key_a: int, key_b: int, sigma_m: float) -> None:
    """That two level robots are about equally high, where they heard each other."""
    far = [UNKNOWN_RAD, UNKNOWN_RAD, UNKNOWN_RAD, UNKNOWN_M, UNKNOWN_M]
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([*far, sigma_m]))
    graph.add(gtsam.BetweenFactorPose3(key_a, key_b, gtsam.Pose3(), noise))


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
