"""How two groups of robots may lie to each other: dense sets of closures, and whether chance explains them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.stats import binom

from wiclosure.backends.sets.chance import chance_distances, chance_to_agree
from wiclosure.backends.sets.claims import Claims
from wiclosure.backends.sets.dense_sets import dense_sets
from wiclosure.types import FloatArray, IntArray

ANCHORS = 250  # closures that all others are compared with
MOST_SETS = 32  # looked at: where clusters of false closures are many, the right set is seldom among the largest
FEW = 4  # closures, of which each may be a set of its own: third robots may tell
FEW_PAIRS = 200  # recombined, that tell of a set which is far larger than chance makes; of as many closures at least
SURELY = 5.0  # standard deviations of their count, which the chance is surely not above


@dataclass(eq=False)
class ClosureComparison:
    """Closures between two groups, compared with each other once; sets follow for any scale of sigma.

    Args:
        claims: N closures.
        beyond: squared Mahalanobis distance up to which distances are exact.
        anchors: `(K,)` rows that the others are compared with.
        between_anchors: `(K, K)` squared distances.
    """

    claims: Claims
    beyond: float
    anchors: IntArray
    between_anchors: FloatArray
    _rows: dict[int, FloatArray] = field(default_factory=dict)  # by anchor, its distances from all
    _sets: dict[tuple[float, int], list[ConsistentSet]] = field(default_factory=dict)  # by what was asked for

    @classmethod
    def of(cls, claims: Claims, beyond: float) -> ClosureComparison:
        """Compares the closures, exactly up to a squared distance of `beyond`."""
        anchors = _anchors(claims, beyond)
        return cls(claims, beyond, anchors, claims.distances(anchors, beyond, anchors))

    @cached_property
    def recombined(self) -> FloatArray:
        """Sorted squared distances of recombined closures, by which the chance is told that sets are asked for."""
        return chance_distances(self.claims)

    @cached_property
    def few_recombined(self) -> FloatArray:
        """The same of `FEW_PAIRS`."""
        return chance_distances(self.claims, FEW_PAIRS)

    def distances(self, members: IntArray) -> FloatArray:
        """`(L, N)` squared distances of some anchors `(L,)` from all closures, each computed when first asked for."""
        missing = [member for member in members.tolist() if member not in self._rows]
        if missing:
            others = np.setdiff1d(np.arange(len(self.claims)), self.anchors)
            rows = np.empty((len(missing), len(self.claims)))
            rows[:, self.anchors] = self.between_anchors[missing]
            rows[:, others] = self.claims.distances(self.anchors[missing], self.beyond, others)
            self._rows.update(zip(missing, rows, strict=True))
        return np.stack([self._rows[member] for member in members.tolist()])

    def consistent_sets(self, limit: float, most: int = MOST_SETS) -> list[ConsistentSet]:
        """Dense sets, largest first.

        Args:
            limit: squared distance within which two closures agree.
            most: how many.
        """
        if (limit, most) not in self._sets:
            self._sets[limit, most] = self._dense_sets(limit, most)
        return self._sets[limit, most]

    def _dense_sets(self, limit: float, most: int) -> list[ConsistentSet]:
        found, taken = [], np.zeros(len(self.claims), bool)
        inside = self.between_anchors <= limit
        for members in dense_sets(inside & inside.T, most):
            agree = self.distances(members) <= limit
            votes = agree.sum(axis=0)
            own = np.zeros(len(self.claims), bool)
            own[self.anchors[members]] = True
            belongs = (votes - own >= 0.5 * (len(members) - own)) & ~taken
            rows = np.flatnonzero(belongs)
            if len(rows) == 0:
                continue
            taken |= belongs
            medoid = self.anchors[members[np.argmax(agree[:, rows].sum(axis=1))]]
            found.append(ConsistentSet(rows, int(medoid), limit, self))
        if len(self.claims) <= FEW:
            alone = np.flatnonzero(~taken)
            found += [ConsistentSet(np.array([row]), int(row), limit, self) for row in alone]
        return found


def _anchors(claims: Claims, beyond: float) -> IntArray:
    """Rows of all closures or, where they are many, of some of every part and of those that most others lie near.

    The first find each set that is a fair share of all, the second the largest, however small a share that is.
    """
    if len(claims) <= ANCHORS:
        return np.arange(len(claims))
    spread = np.linspace(0, len(claims) - 1, ANCHORS // 2).round().astype(np.int64)
    neighbours = claims.neighbours(beyond)
    neighbours[spread] = -1  # chosen already
    crowded = np.argsort(-neighbours, kind="stable")[: ANCHORS - len(spread)]
    return np.union1d(spread, crowded)


@dataclass(frozen=True, eq=False)
class ConsistentSet:
    """A set of closures that agree.

    Args:
        rows: `(K,)` of the claims.
        medoid: the one that most others agree with.
        limit: squared distance within which two agree.
        comparison: of all closures that the set was found among.
    """

    rows: IntArray
    medoid: int
    limit: float
    comparison: ClosureComparison

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def total(self) -> int:
        """Closures that the set was found among."""
        return len(self.comparison.claims)

    @cached_property
    def log_chance(self) -> float:
        """Logarithm of the expected number of sets as large around one of the closures, were all unrelated."""
        if len(self) < 2:
            return float(np.log(self.total))
        claims = self.comparison.claims
        p = chance_to_agree(self.comparison.recombined, self.limit, self.total, claims.degrees)
        return log_expected(len(self), self.total, p)

    def by_chance(self, expected: float) -> bool:
        """Whether more than so many sets as large are expected around one of the closures, were all unrelated."""
        if len(self) > FEW and self.total >= FEW_PAIRS:
            found = int((self.comparison.few_recombined <= self.limit).sum())
            most = (found + SURELY * (1.0 + np.sqrt(found))) / FEW_PAIRS
            if log_expected(len(self), self.total, min(1.0, most)) <= np.log(expected):
                return False
        return self.log_chance > float(np.log(expected))


def log_expected(size: int, total: int, p: float) -> float:
    """Logarithm of the number of sets of a size of two at least, each around one of `total` unrelated closures.

    Args:
        size: closures of a set.
        total: closures.
        p: chance that two unrelated ones agree.
    """
    return float(np.log(total) + binom.logsf(size - 2, total - 1, p))
