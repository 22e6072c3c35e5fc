"""Odometry stated so vaguely that loops within robots which nobody measured would be accepted too.

Variance components of odometry and of loops apart, by the loops that are inliers, again and again: begun with standard
deviations so small that false loops stay out, this ends at those that odometry and true loops have, where there are
enough of them.  Taken only where most loops hold, and loops at any places would not.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import binom

from wiclosure.backends.consistency.merging import MergedGroups, merge_groups
from wiclosure.backends.consistency.own_loops import OwnLoops
from wiclosure.backends.consistency.unchecked_loops import unchecked, unchecked_by
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled
from wiclosure.backends.least_squares.variance_components import CONVERGED, ENOUGH
from wiclosure.backends.sets.candidate_sets import EXPECTED_BY_CHANCE
from wiclosure.backends.sets.known_comparisons import KnownComparisons
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.types import FloatArray

ROUNDS = 12


def merge_told(robots: Robots, settings: MergeSettings, known: KnownComparisons) -> MergedGroups:
    """The groups; where nothing checks the loops within a robot, with the standard deviations that these tell of.

    Args:
        robots: the team.
        settings: of the merge.
        known: comparisons between robots that are as they are here.
    """
    merged = merge_groups(robots, settings, known)
    if settings.most_scale <= 1 or not unchecked(robots, merged, settings):
        return merged
    told = _told(robots, settings, merged.scale)
    if told is None:
        return merged
    of_odometry, factors = told
    restated = robots.loosened(np.full(robots.count, of_odometry)).scaled(factors)
    again = merge_groups(restated, settings.after(factors))
    if unchecked(restated, again, settings):
        return merged
    again.factors, again.odometry_factors = again.factors * factors, again.odometry_factors * of_odometry
    return again


def _told(robots: Robots, settings: MergeSettings, largest: float) -> tuple[float, FloatArray] | None:
    """The factor on the standard deviations of odometry besides those `(2,)` on all; None where loops do not tell."""
    scales = settings.least_scale * 2.0 ** np.arange(np.log2(max(largest / settings.least_scale, 1.0)))
    for scale in scales.tolist():
        found, vague = _converged(robots, settings, scale)
        if found is not None or vague:
            return found
    return None


def _converged(robots: Robots, settings: MergeSettings, scale: float) -> tuple[tuple[float, FloatArray] | None, bool]:
    """From one scale; None where too little is redundant, or chance explains what is accepted.

    And whether loops at any places are accepted from the start: larger scales tell no more.
    """
    of_odometry, factors, vague = 1.0, np.full(2, scale), False
    for step in range(ROUNDS):
        taken = robots.loosened(np.full(robots.count, of_odometry)).scaled(factors)
        own = OwnLoops(taken, settings)
        settled = own.inliers(1.0)
        of_loops = settled.components.without(settled.of_odometry)
        if min(settled.of_odometry.redundancy.min(), of_loops.redundancy.min()) < ENOUGH:
            break
        vague = vague if step else bool(unchecked_by(taken, settled, settings, own.limit))
        more, times = settled.of_odometry.factors / of_loops.factors, of_loops.factors
        ratio = float(np.sqrt(more.prod()))
        of_odometry, factors = of_odometry * ratio, factors * times
        if max(abs(np.log(ratio)), np.abs(np.log(times)).max()) <= np.log(CONVERGED):
            return (of_odometry, factors) if _beats_chance(taken, settled, settings, own.limit) else None, vague
    return None, vague


def _beats_chance(robots: Robots, settled: Settled, settings: MergeSettings, limit: float) -> bool:
    """Whether half of the loops hold at least, more than would by chance, and none of a robot that nothing checks."""
    kept, total = int(settled.inlier[robots.own].sum()), int(robots.own.sum())
    if 2 * kept < total or unchecked_by(robots, settled, settings, limit):
        return False
    shares = unchecked_by(robots, settled, settings, limit, least=0.0)
    return bool(binom.sf(kept - 1, total, max(shares.values(), default=0.0)) < EXPECTED_BY_CHANCE)
