"""Each robot by its own odometry and loops alone."""

from __future__ import annotations

from functools import cached_property, lru_cache

import numpy as np

from wiclosure.backends.consistency.own_claims import OwnClaims
from wiclosure.backends.least_squares.chordal import cheaper, cheaper_start, chordal
from wiclosure.backends.least_squares.graduated import graduated
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled, outlier_limit, settle
from wiclosure.backends.least_squares.system import System
from wiclosure.backends.sets.alignment import ClosureComparison
from wiclosure.backends.sets.known_comparisons import KnownComparisons, key_of_pair
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.pair_sets import claims_between
from wiclosure.types import BoolArray, FloatArray, IntArray

PROBABILITY = 0.99  # that no residual of a right estimate makes another start be tried


class OwnLoops:
    """Each robot by its own loops, with all standard deviations so many times as large as stated.

    Args:
        robots: the team.
        settings: of the merge.
        known: comparisons of closures between robots, where some may be known.
        odometry_factors: `(R,)` that the standard deviations of each robot's odometry were loosened by.
    """

    def __init__(
        self,
        robots: Robots,
        settings: MergeSettings,
        known: KnownComparisons | None = None,
        odometry_factors: FloatArray | None = None,
    ) -> None:
        self.robots, self.settings = robots, settings
        self.known = known or KnownComparisons()
        self.odometry_factors = np.ones(robots.count) if odometry_factors is None else odometry_factors
        self.scaled = lru_cache(2)(robots.scaled)
        self.limit = outlier_limit(len(robots.loops), settings.probability, robots.degrees)
        self.inliers = lru_cache(2)(self._inliers)  # the scale that is decided on is asked for again
        self._told_by = lru_cache(1)(lambda scale, units: self.inliers(scale).scaled(units / scale))  # of all pairs
        self._trusted = lru_cache(2)(self._told_trusted)

    @cached_property
    def all(self) -> Settled | None:
        """By all of them; None where some stand alone against odometry."""
        return self._everything if self._trusted(1.0) is None else None

    def within(self, settled: Settled, times: float) -> int:
        """How many loops lie where an estimate predicts them, with so many times its standard deviations."""
        return int((settled.distance[self.robots.own] <= times**2 * self.limit).sum())

    def comparison(self, rows: IntArray, scale: float, units: float, beyond: float) -> ClosureComparison:
        """All closures between two robots, compared.

        Args:
            rows: the closures.
            scale: of the standard deviations under which inliers within the robots are chosen.
            units: of those that the distances are told by.
            beyond: squared distance up to which these are exact.
        """
        by_all = self._trusted(scale) is None and self._all_fit(scale)  # the same estimate whatever the scale
        key = key_of_pair(self.robots, rows, self.odometry_factors), units, None if by_all else scale

        def compare() -> ClosureComparison:
            claims = claims_between(self.scaled(units), rows, np.arange(self.robots.count), self._told_by(scale, units))
            return ClosureComparison.of(claims, beyond)

        return self.known.of(key, beyond, compare)

    def _all_fit(self, scale: float) -> bool:
        """Whether none contradicts the others."""
        return not (self._everything.distance[self.robots.own] / scale**2 > self.limit).any()

    @cached_property
    def _everything(self) -> Settled:
        return by_all_own_loops(self.robots)

    def _inliers(self, scale: float) -> Settled:
        """By those that agree: all of them, where none contradicts the others."""
        robots, trusted = self.scaled(scale), self._trusted(scale)
        if trusted is not None:
            return self._grown(robots, trusted)
        everything = self._everything.scaled(scale)
        if self._all_fit(scale):
            return everything
        return self._among(robots, robots.own, _system(robots, robots.own), [everything.poses, robots.poses])

    def _told_trusted(self, scale: float) -> BoolArray | None:
        """Loops `(M,)` that neighbours support; None where odometry refutes no other."""
        robots = self.scaled(scale)
        of = OwnClaims.of(robots)
        refuted = of.refuted(self.limit)
        if not refuted.any():
            return None
        found, supported = np.zeros(len(robots.loops), bool), of.supported(self.settings.agree_limit)
        found[robots.own] = supported
        return found if (refuted & ~supported).any() else None

    def _grown(self, robots: Robots, trusted: BoolArray) -> Settled:
        """From the trusted loops, then from all that the estimate by these does not refute.

        The others never enter: each would join two places more, and fill the normal matrix.
        """
        system = _system(robots, trusted)
        by_trusted = self._among(robots, trusted, system, [cheaper_start(system, robots.poses)], rounds=1)
        plausible = robots.own & (by_trusted.distance <= self.limit)
        return self._among(robots, plausible, _system(robots, plausible), [by_trusted.poses])

    def _among(
        self, robots: Robots, candidates: BoolArray, system: System, starts: list[FloatArray], **rounds: int
    ) -> Settled:
        """By the inliers among these, of which the system is; the others are checked against what they predict."""
        inlier = candidates.copy()
        inlier[candidates], poses = graduated(system, len(robots.odometry), starts, self.limit)
        return settle(
            robots.odometry, robots.loops, inlier, robots.own, poses, robots.first_nodes, self.limit, **rounds
        )


def _system(robots: Robots, loops: BoolArray) -> System:
    """Of odometry and some loops `(M,)`."""
    return System.of(robots.odometry + robots.loops.subset(loops), robots.poses, robots.first_nodes)


def by_all_own_loops(robots: Robots) -> Settled:
    """Each robot by all of its own loops: from odometry and, where these fit badly, from chordal initialisation too."""
    own = robots.own
    found = settle(robots.odometry, robots.loops, own, own, robots.poses, robots.first_nodes, np.inf)
    limit = outlier_limit(len(found.redundant), PROBABILITY, robots.degrees)
    if (found.redundant <= limit).all():
        return found
    system = _system(robots, own)
    start = cheaper(system, found.poses, system.solved(chordal(system, found.poses)))
    return settle(robots.odometry, robots.loops, own, own, start, robots.first_nodes, np.inf)
