"""Loops within robots that nothing checks: odometry is taken so vaguely that false ones would fit as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wiclosure import se3
from wiclosure.backends.consistency.merging import MergedGroups
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled, outlier_limit
from wiclosure.backends.sets.claims import Claims
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.types import FloatArray, IntArray

DRAWN = 1000  # loops that nobody measured
NO_CHECK = 0.5  # of them: a check that lets more than half of what is false pass tells nothing


def unchecked(robots: Robots, merged: MergedGroups, settings: MergeSettings) -> dict[int, float]:
    """Share of loops at any places that the estimate would accept, by robot within which it accepts most.

    Args:
        robots: the team.
        merged: the same, merged.
        settings: of the merge.
    """
    limit = merged.room**2 * outlier_limit(len(robots.loops), settings.probability, robots.degrees)
    return unchecked_by(merged.restated(robots), replace(merged.settled, inlier=merged.inlier), settings, limit)


def unchecked_by(
    robots: Robots, settled: Settled, settings: MergeSettings, limit: float, least: float = NO_CHECK
) -> dict[int, float]:
    """The same of an estimate, by robots with standard deviations as it takes them.

    Args:
        robots: likewise.
        settled: the estimate.
        settings: of the merge.
        limit: squared distance up to which a loop is accepted.
        least: share, beyond which it is told.
    """
    view_m = settings.view_steps * robots.step_m
    accepted = np.flatnonzero(robots.own & settled.inlier)
    of_loops, found = robots.robot[robots.loops.first[accepted]], {}
    for robot in np.unique(of_loops).tolist():
        nodes = np.flatnonzero(robots.robot == robot)
        share = _share_that_fits(robots, settled, accepted[of_loops == robot], nodes, limit, view_m)
        if share > least:
            found[robot] = share
    return found


def _share_that_fits(
    robots: Robots, settled: Settled, rows: IntArray, nodes: IntArray, limit: float, view_m: float
) -> float:
    """Of loops measured as those at `rows`, but between any two places of one robot; 0 where it has no two."""
    rng = np.random.default_rng(len(robots.loops))
    first, second = np.sort(rng.choice(nodes, (2, DRAWN)), axis=0)
    apart = robots.along_m[second] - robots.along_m[first] > view_m
    first, second, row = first[apart], second[apart], rng.choice(rows, DRAWN)[apart]
    if not len(row):
        return 0.0
    measured = robots.loops.T[row], robots.loops.covariance[row]
    claims = Claims(
        settled.poses[first], settled.poses[second], *measured, settled.wander[first], settled.wander[second]
    )
    distances: FloatArray = mahalanobis_squared(se3.log(claims.frames), claims.frame_covariance)
    return float(np.mean(distances <= limit))
