"""How many times larger than stated the errors of single robots' odometry are.

A robot whose own loops contradict its odometry has false loops or worse odometry than it states.  The second is taken
where larger errors explain all of its loops, other robots fit as stated (else one factor for all does), and chance
would not: loops recombined of the same ends and measurements tell how often a false one fits so loose an odometry.
"""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.backends.consistency.own_claims import OwnClaims
from wiclosure.backends.consistency.own_loops import OwnLoops, by_all_own_loops
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled, outlier_limit
from wiclosure.backends.sets.candidate_sets import EXPECTED_BY_CHANCE
from wiclosure.backends.sets.claims import Claims
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.pair_sets import count_places
from wiclosure.backends.sets.sigma_scale import NO_MATTER, STEP, of_residuals
from wiclosure.types import FloatArray

RECOMBINED = 1000  # loops, at most, that nobody measured


def odometry_factors(robots: Robots, settings: MergeSettings) -> FloatArray:
    """Factors `(R,)` on the standard deviations of each robot's odometry, at most `most_scale`."""
    limit = outlier_limit(len(robots.loops), settings.probability, robots.degrees)
    own, factors = OwnClaims.of(robots), np.ones(robots.count)
    torn = np.unique(own.robot[own.refuted(limit)])
    of_others = of_residuals(own.distances[~np.isin(own.robot, torn)], robots.degrees)
    if of_others is not None and of_others <= NO_MATTER:
        for robot in torn:
            factors[robot] = _factor(robots.alone(int(robot)), settings, limit)
    return factors


def _factor(robot: Robots, settings: MergeSettings, limit: float) -> float:
    """The smallest, within `STEP`, under which all own loops of a robot fit; 1 if none is or they may be false."""
    too_small, enough = 1.0, settings.most_scale
    loosest = OwnClaims.of(robot.loosened(np.array([enough])))
    if loosest.contradictory(limit, settings.probability, robot.degrees):  # spares an estimate, dense with false ones
        return 1.0
    settled = _if_all_fit(robot, enough, limit)
    if settled is None:
        return 1.0
    while enough > STEP * too_small:
        middle = float(np.sqrt(too_small * enough))
        found = _if_all_fit(robot, middle, limit)
        too_small, enough, settled = (middle, enough, settled) if found is None else (too_small, middle, found)
    false = ~OwnLoops(robot, settings).inliers(1.0).inlier
    places = count_places(robot, np.flatnonzero(false), settings.view_steps * robot.step_m)
    return enough if _chance_to_fit(robot, settled, limit) ** places < EXPECTED_BY_CHANCE else 1.0


def _if_all_fit(robot: Robots, factor: float, limit: float) -> Settled | None:
    """The estimate by all own loops with odometry so much looser; None if some contradict it."""
    settled = by_all_own_loops(robot.loosened(np.array([factor])))
    left = of_residuals(settled.redundant, robot.degrees)
    fits = (settled.distance <= limit).all() and left is not None and left <= NO_MATTER
    return settled if fits else None


def _chance_to_fit(robot: Robots, settled: Settled, limit: float) -> float:
    """Share of recombined loops that the estimate does not contradict."""
    loops, rng = robot.loops, np.random.default_rng(len(robot.loops))
    rows, others = np.divmod(rng.permutation(len(loops) ** 2)[:RECOMBINED], len(loops))
    rows, others = rows[rows != others], others[rows != others]
    first, second = loops.first[rows], loops.second[others]
    claims = Claims(
        settled.poses[first],
        settled.poses[second],
        loops.T[rows],
        loops.covariance[rows],
        settled.wander[first],
        settled.wander[second],
    )
    fits = mahalanobis_squared(se3.log(claims.frames), claims.frame_covariance) <= limit
    return float(fits.mean()) if len(fits) else 1.0
