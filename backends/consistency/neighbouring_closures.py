"""Closures between neighbouring places of the same paths, compared with each other over the odometry in between.

They hardly depend on how far odometry drifts, so they tell sigma where false loops have asked for a larger one: true
ones agree with true ones and false ones of one wrong alignment with such, but not the ones with the others.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from wiclosure import se3
from wiclosure.backends.consistency.merging import MergedGroups
from wiclosure.backends.consistency.own_claims import NEIGHBOURS, PAIRS_AT_ONCE, OwnClaims
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.backends.odometry_jump import Jump
from wiclosure.backends.sets.sigma_scale import ENOUGH, FAR_APART, QUANTILES, far_apart, of_residuals
from wiclosure.types import FloatArray, IntArray


def robots_in_contradiction(
    team: TeamArrays, merged: MergedGroups, jumps: Sequence[Jump] = ()
) -> tuple[str, str] | None:
    """Two robots, or one twice, between which closures are accepted that contradict neighbours far more than most do.

    Args:
        team: the arrays.
        merged: its decisions, and standard deviations as they are taken.
        jumps: where odometry is not believed.

    Returns:
        Those of which most of the contradicting ones are; None if there are none.
    """
    rows = np.flatnonzero(merged.inlier)
    if len(rows) < ENOUGH:
        return None
    robots = merged.restated(team.robots)
    for jump in jumps:
        robots = robots.cut(jump.node)
    claims = _claims(robots, rows)
    one, other = _neighbours(claims)
    distances = _distances(claims, one, other)
    largest = of_residuals(distances, robots.degrees)
    if largest is None or largest < 1.0 / FAR_APART or not far_apart(distances, robots.degrees):
        return None  # all far closer to each other than sigma has it: nothing contradicts
    worst = rows[one[distances >= np.quantile(distances, QUANTILES[-1])]]
    ends = np.sort(team.robots.robot[team.robots.loop_ends[:, worst]], axis=0)
    pairs, counts = np.unique(ends, axis=1, return_counts=True)
    first, second = pairs[:, np.argmax(counts)].tolist()
    return team.names[first], team.names[second]


def _claims(robots: Robots, rows: IntArray) -> OwnClaims:
    """Of the closures at `rows`, from the lower node to the higher."""
    loops = robots.loops.subset(rows)
    turned = loops.first > loops.second
    loops.covariance[turned] = se3.inverse_covariance(loops.T[turned], loops.covariance[turned])
    loops.T[turned] = se3.inverse(loops.T[turned])
    ends = np.sort([loops.first, loops.second], axis=0)
    return OwnClaims(robots, ends[0], ends[1], loops.T, loops.covariance)


def _neighbours(claims: OwnClaims) -> tuple[IntArray, IntArray]:
    """Pairs `(P,)`, `(P,)` of the same robots, each once, whose ends are nearest along both paths.

    Of two within one robot, the later ends lie behind both earlier ones: no step of odometry counts for both ends.
    """
    robots, count = claims.robots, len(claims)
    of_ends = robots.robot[[claims.first, claims.second]]
    along_m = robots.along_m[[claims.first, claims.second]]
    apart_m = 4.0 * along_m.max(initial=0.0) + 1.0  # other robots are no neighbours
    places = np.concatenate([along_m, apart_m * of_ends]).T
    _, nearest = cKDTree(places).query(places, k=min(NEIGHBOURS + 1, count))
    pairs = np.stack([np.repeat(np.arange(count), nearest.shape[1]), nearest.ravel()])
    one, other = np.unique(np.sort(pairs, axis=0), axis=1)
    comparable = (one != other) & (of_ends[:, one] == of_ends[:, other]).all(axis=0)
    comparable &= np.maximum(claims.first[one], claims.first[other]) < np.minimum(
        claims.second[one], claims.second[other]
    )
    return one[comparable], other[comparable]


def _distances(claims: OwnClaims, one: IntArray, other: IntArray) -> FloatArray:
    """Squared Mahalanobis distances `(P,)` by odometry between the ends."""
    found = [np.zeros(0)]
    for at in range(0, len(one), PAIRS_AT_ONCE):
        a, b = one[at : at + PAIRS_AT_ONCE], other[at : at + PAIRS_AT_ONCE]
        along_first, along_second = (
            claims.drift[np.maximum(ends[a], ends[b])] - claims.drift[np.minimum(ends[a], ends[b])]
            for ends in (claims.first, claims.second)
        )
        moved = se3.rotate_covariance(se3.adjoint(se3.inverse(claims.frames[a])), along_first)
        error = se3.log(se3.between(claims.frames[a], claims.frames[b]))
        found.append(mahalanobis_squared(error, claims.noise[a] + claims.noise[b] + moved + along_second))
    return np.concatenate(found)
