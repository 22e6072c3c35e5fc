"""The factor on all standard deviations: of what robots say within themselves, else of the sets between them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from wiclosure.backends.consistency.own_loops import OwnLoops
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled
from wiclosure.backends.sets import sigma_scale
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.pair_sets import pairs_of_groups

REFINEMENTS = 4  # of the factor
TELLING_PAIRS = 50  # of robots, those with most closures, that tell it
WIDER = 2.0  # times the sigma, under which few more loops hold where those that do not are false
VAGUE = 0.2  # of a path's extent: where odometry drifts as far, false loops fit as well
MOST = 0.95  # of the loops, which as many sigmas as that leave in


def scale_of(robots: Robots, settings: MergeSettings, own: OwnLoops) -> float:
    """Of inliers within robots, and no larger than keeps false loops out; without any, of sets between robots."""
    return _finer(robots, settings, own, _fitting(robots, settings, own))


def allowed(scale: float, settings: MergeSettings) -> float:
    """Within the limits; 1 where it is near 1."""
    return sigma_scale.settled(scale, settings.least_scale, settings.most_scale)


def finer_ones(robots: Robots, settings: MergeSettings, scale: float) -> Iterator[float]:
    """Smaller factors, each half of the one before, where odometry is so vague that false loops fit as well as true."""
    if robots.scaled(scale).drift_share() > VAGUE:
        while scale > 2.0 * settings.least_scale:
            scale *= 0.5
            yield scale


def _fitting(robots: Robots, settings: MergeSettings, own: OwnLoops) -> float:
    most, everything = settings.most_scale, own.all
    known = _asked_for(everything, robots) if everything else None
    if everything is None or (known is not None and known > sigma_scale.NO_MATTER):
        as_stated = own.inliers(1.0)
        fitting = _asked_for(as_stated, robots)
        # Where sigma is too small, few do, by chance.
        most_fit = 2 * as_stated.inlier.sum() >= own.within(as_stated, WIDER)
        if fitting is not None and fitting <= sigma_scale.NO_MATTER and most_fit:
            return allowed(fitting, settings)  # the others are false
    if everything is None:
        known = _asked_for(own.inliers(most).scaled(1.0 / most), robots)
    scale = most
    for _ in range(REFINEMENTS):
        if known is None:
            break
        before, scale = scale, allowed(known, settings)
        if scale > before / sigma_scale.NO_MATTER:  # no smaller: what is left are inliers
            return scale
        known = _asked_for(own.inliers(scale).scaled(1.0 / scale), robots)
    return _of_sets(robots, settings, own) if known is None else scale


def _of_sets(robots: Robots, settings: MergeSettings, own: OwnLoops) -> float:
    most, widest = settings.most_scale, settings.agree_limit * (2.0 * settings.most_scale) ** 2
    largest = sorted(pairs_of_groups(robots, np.arange(robots.count)), key=len, reverse=True)[:TELLING_PAIRS]
    comparisons = [own.comparison(rows, most, 1.0, widest) for rows in largest]
    return allowed(sigma_scale.of_sets(comparisons, settings.agree_limit, most), settings)


def _finer(robots: Robots, settings: MergeSettings, own: OwnLoops, scale: float) -> float:
    """A smaller factor, where residuals are far apart or odometry knows little, and the loops it leaves out are false.

    Where sigma is stated far too large, false loops fit it by accident and strain all else.  They stay out under a
    larger sigma as well than the other residuals ask for, while of true ones more and more would fit.
    """
    vague = robots.scaled(scale).drift_share() > VAGUE
    if not vague and not sigma_scale.far_apart(own.inliers(scale).redundant, robots.degrees):
        return scale
    room = 0.5 * scale
    while room > settings.least_scale:
        settled = own.inliers(room)
        kept, fitting = settled.inlier.sum(), _asked_for(settled, robots)
        if fitting is None or 2 * kept < robots.own.sum():
            return scale
        if fitting <= 0.5 and own.within(settled, fitting) >= MOST * kept:
            return allowed(fitting * room, settings)
        room *= 0.5
    return scale


def _asked_for(settled: Settled, robots: Robots) -> float | None:
    return sigma_scale.of_residuals(settled.redundant, robots.degrees)
