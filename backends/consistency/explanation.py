"""A team as it may have been, merged: what its measurements cost then."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from wiclosure.backends.consistency.merging import MergedGroups, cost_of_rejected
from wiclosure.backends.consistency.vague_odometry import merge_told
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.sets.candidate_sets import SATURATED
from wiclosure.backends.sets.known_comparisons import KnownComparisons
from wiclosure.backends.sets.merge_settings import MergeSettings


@dataclass(frozen=True, eq=False)
class Explanation:
    """A team with some robots cut, merged.

    Args:
        robots: the team.
        merged: what came of it.
        nodes: those before which robots are cut, of the uncut team.
        known: comparisons of closures between its robots.
    """

    robots: Robots
    merged: MergedGroups
    nodes: tuple[int, ...] = ()
    known: KnownComparisons = field(default_factory=KnownComparisons)

    @classmethod
    def of(cls, robots: Robots, settings: MergeSettings) -> Explanation:
        """With no robot cut."""
        known = KnownComparisons()
        return cls(robots, merge_told(robots, settings, known), known=known)

    def cut(self, node: int, settings: MergeSettings) -> Explanation:
        """With one cut more."""
        robots, known = self.robots.cut(node), KnownComparisons(self.known)
        return Explanation(robots, merge_told(robots, settings, known), (*self.nodes, node), known)

    @cached_property
    def restated(self) -> Robots:
        """With standard deviations as the merge found them."""
        return self.merged.restated(self.robots)

    def cost(self, settings: MergeSettings) -> float:
        """Of the merge; parts of robots that were cut are taken apart."""
        return self.merged.cost(self.robots, settings)

    def gained(self, before: Explanation, settings: MergeSettings) -> float:
        """By how much it lowers the cost; 0 where it is no more than by taking one look-alike place for true."""
        if self is before:
            return 0.0
        gained = before.cost(settings) - self.cost(settings)
        return gained if gained > self.one_place(settings) else 0.0

    def one_place(self, settings: MergeSettings) -> float:
        """What rejecting as many closures costs as one place may have."""
        return SATURATED * cost_of_rejected(self.robots, settings)
