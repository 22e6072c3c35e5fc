"""Each robot by its own odometry and loops alone."""

from __future__ import annotations

import logging

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.edges import Edges, System
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled, graduated, outlier_limit, settle
from wiclosure.types import FloatArray

logger = logging.getLogger(__name__)

PROBABILITY = 0.99  # that no residual of a right estimate makes another start be tried


def by_all_own_loops(robots: Robots) -> Settled:
    """Each robot by all of its own loops: from odometry and, where these fit badly, from chordal initialisation too."""
    own = robots.own
    found = settle(robots.odometry, robots.loops, own, own, robots.poses, robots.first_nodes, np.inf)
    limit = outlier_limit(len(found.redundant), PROBABILITY, robots.degrees)
    if (found.redundant <= limit).all():
        return found
    start = _cheaper(robots, found.poses)
    return settle(robots.odometry, robots.loops, own, own, start, robots.first_nodes, np.inf)


def by_own_inliers(robots: Robots, everything: Settled, limit: float) -> Settled:
    """Each robot by its own loops: all of them, where none contradicts the others."""
    own = robots.own
    if not (everything.distance[own] > limit).any():
        return everything
    inlier = own.copy()
    starts = [everything.poses, robots.poses]
    inlier[own], poses = graduated(robots.odometry, robots.loops.subset(own), starts, robots.first_nodes, limit)
    return settle(robots.odometry, robots.loops, inlier, own, poses, robots.first_nodes, limit)


def _cheaper(robots: Robots, poses: FloatArray) -> FloatArray:
    """Of each robot by its own loops, the poses given or the minimum that chordal initialisation leads to."""
    edges, of_robot = robots.odometry + robots.loops.subset(np.flatnonzero(robots.own)), robots.robot
    system, others = System.of(edges, len(poses), robots.first_nodes), poses.copy()
    for root in robots.first_nodes.tolist():
        rows = np.flatnonzero(of_robot[edges.first] == of_robot[root])
        if len(rows):
            others = _chordal(edges.subset(rows), root, others)
    others = system.solved(others)
    costs = [np.bincount(of_robot[edges.first], system.chi_squares(of), robots.count) for of in (poses, others)]
    return np.where((costs[1] < costs[0])[of_robot][:, None, None], others, poses)


def _chordal(edges: Edges, root: int, poses: FloatArray) -> FloatArray:
    """The poses `(N, 4, 4)` with those of one robot by its edges alone: rotations relaxed, then positions.

    Carlone et al., "Initialization techniques for 3D SLAM", ICRA 2015.  Unchanged where that fails.
    """
    graph, changed = gtsam.NonlinearFactorGraph(), poses.copy()
    sigmas = np.sqrt(np.diagonal(edges.covariance, axis1=1, axis2=2))
    for first, second, T, sigma in zip(edges.first.tolist(), edges.second.tolist(), edges.T, sigmas, strict=True):
        noise = gtsam.noiseModel.Diagonal.Sigmas(sigma)
        graph.add(gtsam.BetweenFactorPose3(first, second, gtsam.Pose3(T), noise))
    graph.add(gtsam.PriorFactorPose3(root, gtsam.Pose3(poses[root]), gtsam.noiseModel.Isotropic.Sigma(6, 1.0)))
    try:
        values = gtsam.InitializePose3.initialize(graph)
    except RuntimeError:  # GTSAM's own, thrown for indeterminate systems
        logger.debug("chordal initialisation failed", exc_info=True)
        return poses
    nodes = np.unique(np.concatenate([edges.first, edges.second]))
    found = np.stack([values.atPose3(int(node)).matrix() for node in nodes])
    changed[nodes] = poses[root] @ se3.inverse(values.atPose3(root).matrix()) @ found
    return changed if np.isfinite(changed).all() else poses
