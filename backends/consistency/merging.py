"""Robots become groups, groups one map: sets of closures that agree join them, and the rest checks every closure.

Each round compares all closures between two groups (of whichever of their robots), so that closures of different pairs
of robots check each other over third robots; sets that hold join their groups, and the joined groups are estimated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from wiclosure.backends.consistency.group_cycles import settle_cycles
from wiclosure.backends.consistency.joining import connect, joined_groups, strongest
from wiclosure.backends.consistency.odometry_factors import odometry_factors
from wiclosure.backends.consistency.own_loops import OwnLoops
from wiclosure.backends.consistency.scale import REFINEMENTS, allowed, finer_ones, scale_of
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled, outlier_limit, settle
from wiclosure.backends.least_squares.variance_components import CONVERGED, VarianceComponents, separate_factors
from wiclosure.backends.sets import sigma_scale
from wiclosure.backends.sets.alignment import ClosureComparison
from wiclosure.backends.sets.candidate_sets import CandidateSet
from wiclosure.backends.sets.known_comparisons import KnownComparisons
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.pair_sets import pairs_of_groups, places_of_groups, sets_between, stands
from wiclosure.types import BoolArray, FloatArray, IntArray

SEPARATIONS = 2  # of sigma's scale into components: with the second, those that the first has admitted tell as well
TORN = "what the estimate leaves of its set would not be accepted"


@dataclass(eq=False)
class MergedGroups:
    """What came of it.

    Args:
        inlier: `(M,)` closures that are accepted.
        group: `(R,)` of each robot.
        reason: by closure, where it is rejected.
        candidates: sets between robots of the first round.
        settled: the estimate within the groups.
        factors: `(2,)` on the standard deviations of rotation and of translation.
        room: factor on those of closures besides, up to which they are inliers: odometry may be stated better.
        odometry_factors: `(R,)` on those of each robot's odometry besides.
    """

    inlier: BoolArray
    group: IntArray
    reason: dict[int, str]
    candidates: list[CandidateSet]
    settled: Settled
    factors: FloatArray
    room: float = 1.0
    odometry_factors: FloatArray = field(default_factory=lambda: np.ones(1))

    @property
    def scale(self) -> float:
        """One factor up to which closures are inliers."""
        return float(self.room * self.factors.max())

    def restated(self, robots: Robots) -> Robots:
        """The robots with standard deviations as the merge found them."""
        return robots.loosened(self.odometry_factors).scaled(self.factors)

    def cost(self, robots: Robots, settings: MergeSettings) -> float:
        """Minus twice the logarithm of the likelihood, up to a constant; a rejected closure costs what the limit is."""
        of = self.restated(robots)
        odometry, loops = (
            mahalanobis_squared(edges.errors(self.settled.poses), edges.covariance) for edges in (of.odometry, of.loops)
        )
        scaled = of.degrees * float(np.log(self.factors).sum())  # the determinant of a covariance, twice its root's
        loosened = 2.0 * of.degrees * np.log(self.odometry_factors)[of.robot[of.odometry.first]]
        of_loops = np.where(self.inlier, loops + scaled, cost_of_rejected(of, settings))
        return float((odometry + loosened + scaled).sum() + of_loops.sum())

    def restricted_cost(self, robots: Robots, settings: MergeSettings) -> float:
        """The same of the restricted likelihood (REML), of which poses are integrated out: to compare factors by.

        Odometry fits under any factor, and so does a loop for each two groups that join: what nothing checks tells
        nothing of sigma.
        """
        unchecked = len(robots.odometry) + robots.count - len(np.unique(self.group))
        return self.cost(robots, settings) - unchecked * robots.degrees * float(np.log(self.factors).sum())


def cost_of_rejected(robots: Robots, settings: MergeSettings) -> float:
    """Of one closure, as a squared distance."""
    return outlier_limit(len(robots.loops), settings.probability, robots.degrees)


def merge_groups(robots: Robots, settings: MergeSettings, known: KnownComparisons | None = None) -> MergedGroups:
    """Joins robots until nothing joins any more, with the scale of sigma that fits what is found.

    Args:
        robots: the team.
        settings: of the merge.
        known: comparisons between robots that are as they are here.
    """
    if settings.most_scale <= 1:
        return _merged(robots, settings, OwnLoops(robots, settings, known), 1.0)
    of_odometry = odometry_factors(robots, settings)
    robots = robots.loosened(of_odometry)
    merged = _under_one_factor(robots, settings, OwnLoops(robots, settings, known, of_odometry))
    for _ in range(SEPARATIONS):
        factors = _separated(robots, settings, merged)
        if factors is None:
            break
        restated = robots.scaled(factors)
        after = settings.after(factors)
        merged = _under_one_factor(restated, after, OwnLoops(restated, after))
        merged.factors = merged.factors * factors
    merged.odometry_factors = of_odometry
    return merged


def _under_one_factor(robots: Robots, settings: MergeSettings, own: OwnLoops) -> MergedGroups:
    """By the factor that own loops ask for, then by those that what each leaves asks for, as long as they go one way.

    Where most own loops are false, the first may be far too large: some of them are accepted and strain the others, so
    that residuals are far apart.  What most of these ask for is taken where that costs less.
    """
    scale, before = scale_of(robots, settings, own), 0.0
    merged = _merged(robots, settings, own, scale)
    if sigma_scale.far_apart(merged.settled.redundant, robots.degrees):
        finer = allowed(scale * sigma_scale.of_most(merged.settled.redundant, robots.degrees), settings)
        tried = _merged(robots, settings, own, finer)
        if tried.cost(robots, settings) < merged.cost(robots, settings):
            scale, merged = finer, tried
    for finer in finer_ones(robots, settings, scale):
        tried = _merged(robots, settings, own, finer)
        if sigma_scale.of_residuals(tried.settled.redundant, robots.degrees) is None:
            break
        if tried.restricted_cost(robots, settings) < merged.restricted_cost(robots, settings):
            scale, merged = finer, tried
    for _ in range(REFINEMENTS):
        left = sigma_scale.of_residuals(merged.settled.redundant, robots.degrees)
        better = allowed(scale * (left or 1.0), settings)
        change = float(np.log(better / scale))
        if abs(change) <= np.log(sigma_scale.NO_MATTER) or change * before < 0:
            break
        scale, before = better, change
        merged = _merged(robots, settings, own, scale)
    return merged


def _separated(robots: Robots, settings: MergeSettings, merged: MergedGroups) -> FloatArray | None:
    """Factors `(2,)` that fit the merged groups better, within what is allowed; None if those they have do."""

    def under(more: FloatArray) -> VarianceComponents:
        of = robots.scaled(merged.factors * more)
        return settled_within(of, merged.group, merged.inlier, merged.settled.poses, np.inf).components

    bounds = settings.least_scale / merged.factors, settings.most_scale / merged.factors
    more = separate_factors(merged.settled.components, under, bounds)
    return None if (more == 1.0).all() else merged.factors * more


def _merged(robots: Robots, settings: MergeSettings, own: OwnLoops, scale: float) -> MergedGroups:
    """Round after round."""
    limit, robots = outlier_limit(len(robots.loops), settings.probability, robots.degrees), robots.scaled(scale)
    group, settled = np.arange(robots.count), own.inliers(scale)
    of_robots: list[CandidateSet] | None = None
    torn = np.zeros(len(robots.loops), bool)  # closures of sets of which too little was left
    while True:
        places = places_of_groups(robots, group, settled)
        pairs = [rows[~torn[rows]] for rows in pairs_of_groups(robots, group) if not torn[rows].all()]
        known: list[ClosureComparison | None] = [None] * len(pairs)
        if of_robots is None:
            known = [own.comparison(rows, scale, scale, settings.agree_limit) for rows in pairs]
        candidates = [
            c
            for rows, compared in zip(pairs, known, strict=True)
            for c in sets_between(robots, rows, group, settled, settings, compared)
        ]
        settle_cycles(candidates, places, settings.agree_limit, settings.ambiguous_share)
        of_robots = candidates if of_robots is None else of_robots
        holding = strongest(candidates, settings.ambiguous_share)
        if not holding:
            break
        new_group, poses, joining = joined_groups(robots, group, settled, holding, settings.agree_limit)
        inlier = settled.inlier.copy()
        inlier[np.concatenate([c.rows for c in joining])] = True
        after = settled_within(robots, new_group, inlier, poses, limit)
        standing = [c for c in joining if stands(robots, c, after.inlier, group, settled, settings)]
        if connect(standing, group, new_group):
            group, settled = new_group, after
        else:
            torn[np.concatenate([c.rows for c in joining if c not in standing])] = True
    room = sigma_scale.of_residuals(settled.distance[settled.inlier], robots.degrees) or 1.0
    if settings.most_scale > 1 and room > CONVERGED:
        settled = settled_within(robots, group, settled.inlier, settled.poses, room**2 * limit)
    else:
        room = 1.0
    reasons = _reasons(robots, group, settled, candidates, torn)
    return MergedGroups(
        settled.inlier, group, reasons, of_robots, settled, np.full(2, scale), room, np.ones(robots.count)
    )


def settled_within(robots: Robots, group: IntArray, inlier: BoolArray, poses: FloatArray, limit: float) -> Settled:
    """The estimate within the groups, from these inliers of theirs and poses; without a limit, of no other closures."""
    first, second = robots.groups_of_ends(group)
    held = np.array([robots.first_nodes[np.flatnonzero(group == g)[0]] for g in np.unique(group)])
    inside = (first == second) & (inlier | np.isfinite(limit))
    return settle(robots.odometry, robots.loops, inlier & inside, inside, poses, held, limit)


def _reasons(
    robots: Robots, group: IntArray, settled: Settled, last: Sequence[CandidateSet], torn: BoolArray
) -> dict[int, str]:
    """Why closures are rejected."""
    first, second = robots.groups_of_ends(group)
    reasons: dict[int, str] = {}
    for candidate in reversed(last):
        for row in candidate.rows.tolist():
            reasons[row] = candidate.refutation or candidate.objection
    for row in np.flatnonzero(~settled.inlier).tolist():
        if first[row] == second[row]:
            sigmas = np.sqrt(settled.distance[row])
            reasons[row] = f"contradicts what the other closures and odometry predict, {sigmas:.1f} sigma off"
        else:
            reasons.setdefault(row, TORN if torn[row] else "no other closure agrees with it")
    return reasons
