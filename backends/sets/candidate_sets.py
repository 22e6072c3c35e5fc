"""Sets of closures between groups of robots, and what is known for and against each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq

from wiclosure.backends.sets.alignment import ClosureComparison, ConsistentSet
from wiclosure.types import BoolArray, FloatArray

SATURATED = 5  # places beyond which a set is no more certain: one look-alike street yields any number
EXPECTED_BY_CHANCE = 0.005  # sets that chance would make: one in two hundred graphs without a true closure


def least_span(closures: int, spanned_less: float = 0.01) -> float:
    """Share of both paths that all but `spanned_less` of the sets of so many closures at any places of them span.

    Of n places drawn from a path, the range is less than the share s with probability `n s^(n-1) - (n-1) s^n`.
    """
    of_one_path = np.sqrt(spanned_less)
    return float(
        brentq(lambda s: closures * s ** (closures - 1) - (closures - 1) * s**closures - of_one_path, 0.0, 1.0)
    )


LEAST_COVERAGE = least_span(3)  # less is one place: a fifth
LEAST_OF_THREE = least_span(3, EXPECTED_BY_CHANCE)  # a sixth; the same of three closures, which seldom span more


Places = Mapping[int, tuple[FloatArray, FloatArray]]
"""By group: poses `(K, 4, 4)` of its nodes and samples `(K, 6, S)` of their errors."""


@dataclass(eq=False)
class CandidateSet:
    """A set of closures between the pair `(a, b)` of groups, and what is known for and against it.

    Args:
        a, b: groups, a < b.
        rows: closures, of all.
        closure_set, comparison: from `alignment`.
        objection: why the pair alone does not settle it; empty if it does.
        coverage: share of both paths that the closures' ends span.
        rivalled: whether another set of its pair is all that objects to it.
        one_place: whether all that objects to it within the pair is that it may be of one look-alike place.
        support, contradiction: of cycles over third groups.
        places: of its closures, each within a view: neighbours of one look-alike place agree for one reason.
        frame, noise, wander: where the second group lies in the first by all of its closures (`Claims.mean_frame`).
    """

    a: int
    b: int
    rows: np.ndarray
    closure_set: ConsistentSet
    comparison: ClosureComparison
    objection: str = ""
    rivalled: bool = False
    one_place: bool = False
    coverage: float = 1.0
    support: float = 0.0
    contradiction: float = 0.0
    refutation: str = ""
    places: int = field(init=False)
    frame: FloatArray = field(init=False)
    noise: FloatArray = field(init=False)
    wander: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        claims, self.places = self.comparison.claims, len(self)
        self.frame, self.noise, self.wander = claims.mean_frame(self.closure_set.rows, self.closure_set.medoid)

    def __len__(self) -> int:
        return len(self.closure_set)

    def subset(self, kept: BoolArray) -> CandidateSet:
        """Some of its closures `(K,)`, one at least, with nothing known for or against them but the cycles."""
        of = self.closure_set
        rows = of.rows[kept]
        medoid = of.medoid if of.medoid in rows else int(rows[0])
        left = ConsistentSet(rows, medoid, of.limit, of.comparison)
        return CandidateSet(self.a, self.b, self.rows[kept], left, self.comparison, support=self.support)

    @property
    def weight(self) -> float:
        """What it counts for against others: the places of its closures, by the share of the paths that they span."""
        return min(self.places, SATURATED) * max(self.coverage, LEAST_COVERAGE)

    @property
    def strength(self) -> float:
        """Its weight, and that of cycles which close over it."""
        return self.weight + self.support

    @property
    def holds(self) -> bool:
        """Whether it may join its groups."""
        return not self.refutation and (not self.objection or self.support > 0)
