"""Each robot by its own odometry and loops alone."""

from __future__ import annotations

import numpy as np

from wiclosure.backends.least_squares.chordal import chordal
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled, graduated, outlier_limit, settle
from wiclosure.backends.least_squares.system import System
from wiclosure.types import FloatArray

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
    edges, of_robot = robots.odometry + robots.loops.subset(robots.own), robots.robot
    system = System.of(edges, poses, robots.first_nodes)
    others = system.solved(chordal(system, poses))
    costs = [np.bincount(of_robot[edges.first], system.chi_squares(of), robots.count) for of in (poses, others)]
    return np.where((costs[1] < costs[0])[of_robot][:, None, None], others, poses)
