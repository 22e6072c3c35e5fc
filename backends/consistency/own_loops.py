"""Each robot by its own odometry and loops alone."""

from __future__ import annotations

import numpy as np

from wiclosure.backends.least_squares.chordal import cheaper, chordal
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled, graduated, outlier_limit, settle
from wiclosure.backends.least_squares.system import System

PROBABILITY = 0.99  # that no residual of a right estimate makes another start be tried


def by_all_own_loops(robots: Robots) -> Settled:
    """Each robot by all of its own loops: from odometry and, where these fit badly, from chordal initialisation too."""
    own = robots.own
    found = settle(robots.odometry, robots.loops, own, own, robots.poses, robots.first_nodes, np.inf)
    limit = outlier_limit(len(found.redundant), PROBABILITY, robots.degrees)
    if (found.redundant <= limit).all():
        return found
    system = System.of(robots.odometry + robots.loops.subset(own), found.poses, robots.first_nodes)
    start = cheaper(system, found.poses, system.solved(chordal(system, found.poses)))
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
