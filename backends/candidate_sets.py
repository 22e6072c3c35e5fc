"""Which sets of closures between groups hold: each alone, and with those of other pairs over cycles of three."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from wiclosure import se3
from wiclosure.backends.alignment import ClosureComparison, ConsistentSet
from wiclosure.backends.claims import PAIRS_AT_ONCE, Claims, chance_to_agree
from wiclosure.backends.edges import mahalanobis_squared
from wiclosure.types import FloatArray

SATURATED = 5  # closures beyond which a set is no more certain: one look-alike street yields any number
RECOMBINED = 100  # frames tried to see whether chance closes a cycle as well
MOST_CYCLES = 300_000
EXPECTED_BY_CHANCE = 0.005  # sets that chance would make: one in two hundred graphs without a true closure


Frame = tuple[FloatArray, FloatArray, FloatArray]
"""Transforms `(..., 4, 4)`, their covariances by measurement, and samples of their errors by the groups' estimates."""

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
        extent: of the closures' ends along either path, by how far apart scans still match.
        support, contradiction: of cycles over third groups.
    """

    a: int
    b: int
    rows: np.ndarray
    closure_set: ConsistentSet
    comparison: ClosureComparison
    objection: str = ""
    extent: float = 1.0
    support: float = 0.0
    contradiction: float = 0.0
    refutation: str = ""
    frame: FloatArray = field(init=False)
    noise: FloatArray = field(init=False)
    wander: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        claims, medoid = self.comparison.claims, self.closure_set.medoid
        self.frame, self.noise, self.wander = claims.frames[medoid], claims.noise[medoid], claims.wander[medoid]

    def __len__(self) -> int:
        return len(self.closure_set)

    @property
    def weight(self) -> float:
        """What it counts for against others: closures, half as much where they all see one place."""
        return min(len(self), SATURATED) * 0.5 * (1.0 + min(self.extent, 1.0))

    @property
    def strength(self) -> float:
        """Its weight, and that of cycles which close over it."""
        return self.weight + self.support

    @property
    def holds(self) -> bool:
        """Whether it may join its groups."""
        return not self.refutation and (not self.objection or self.support > 0)


def settle_cycles(candidates: Sequence[CandidateSet], places: Places, limit: float, clearly: float) -> None:
    """Closes all cycles of three: open sets that a cycle closes hold, sets that more speaks against than for fall.

    Of an open cycle the weakest set falls alone only if it is clearly so, else all that are about as weak: which of
    them is wrong, nothing tells.

    Args:
        candidates: all sets.
        places: where closures could be, to see how often chance closes a cycle.
        limit: squared distance within which a cycle closes.
        clearly: share of another's strength below which a set is the weaker one.
    """
    cycles = _cycles(candidates)
    if not cycles:
        return
    closed = _distances(candidates, cycles) <= limit
    rare = EXPECTED_BY_CHANCE / len(cycles)
    alive = [
        (cycle, bool(shut))
        for cycle, shut in zip(cycles, closed, strict=True)
        if not shut or _chance_to_close(candidates, cycle, places, limit) <= rare
    ]
    while True:
        _weigh(candidates, alive)
        contested = [c for c in candidates if c.contradiction > 0]
        worst = max(contested, key=lambda c: c.contradiction - c.strength, default=None)
        if worst is None or worst.contradiction < clearly * worst.strength:
            return
        for cycle, shut in alive:
            members = [candidates[n] for n in cycle]
            if not shut and any(m is worst for m in members) and all(m.holds for m in members):
                for member in members:
                    if member.strength <= worst.strength / clearly:
                        member.refutation = "contradicts the closures with other robots, over a third one"
        gone = {n for n, c in enumerate(candidates) if c.refutation}
        alive = [(cycle, shut) for cycle, shut in alive if not gone & set(cycle)]


def _weigh(candidates: Sequence[CandidateSet], alive: Sequence[tuple[tuple[int, int, int], bool]]) -> None:
    """What closed and open cycles say; an open one says that one of three is wrong, if all three hold otherwise."""
    for candidate in candidates:
        candidate.support = candidate.contradiction = 0.0
    for cycle, shut in alive:
        for n in cycle if shut else ():
            candidates[n].support += min(candidates[m].weight for m in cycle if m != n)
    holding = [candidate.holds for candidate in candidates]
    for cycle, shut in alive:
        for n in cycle if not shut and all(holding[m] for m in cycle) else ():
            candidates[n].contradiction += min(candidates[m].strength for m in cycle if m != n)


def _cycles(candidates: Sequence[CandidateSet]) -> list[tuple[int, int, int]]:
    """Triples of candidates on the pairs (a, b), (b, c) and (a, c)."""
    by_pair: dict[tuple[int, int], list[int]] = defaultdict(list)
    for n, candidate in enumerate(candidates):
        by_pair[candidate.a, candidate.b].append(n)
    near: dict[int, set[int]] = defaultdict(set)
    for a, b in by_pair:
        near[a].add(b)
    found: list[tuple[int, int, int]] = []
    for a in sorted(near):
        for b, c in combinations(sorted(near[a]), 2):
            if c not in near[b]:
                continue
            found += [(x, y, z) for x in by_pair[a, b] for y in by_pair[b, c] for z in by_pair[a, c]]
            if len(found) > MOST_CYCLES:
                return found
    return found


def _distances(candidates: Sequence[CandidateSet], cycles: Sequence[tuple[int, int, int]]) -> FloatArray:
    """Squared Mahalanobis distance of each cycle from closing."""
    frame, noise, wander = (np.stack([getattr(c, name) for c in candidates]) for name in ("frame", "noise", "wander"))
    index, found = np.array(cycles), []
    for start in range(0, len(index), PAIRS_AT_ONCE):
        ab, bc, ac = ((frame[n], noise[n], wander[n]) for n in index[start : start + PAIRS_AT_ONCE].T)
        found.append(mahalanobis_squared(*_closing(ab, bc, ac)))
    return np.concatenate(found)


def _closing(ab: Frame, bc: Frame, ac: Frame) -> tuple[FloatArray, FloatArray]:
    """Errors `(M, 6)` of cycles in the third group's frame, and covariances."""
    error = se3.log(se3.between(ac[0], ab[0] @ bc[0]))
    to_c = se3.adjoint(se3.inverse(bc[0]))
    wander = to_c @ ab[2] + bc[2] - ac[2]
    covariance = se3.rotate_covariance(to_c, ab[1]) + bc[1] + ac[1] + wander @ np.swapaxes(wander, -1, -2)
    return error, covariance


def _chance_to_close(
    candidates: Sequence[CandidateSet], cycle: tuple[int, int, int], places: Places, limit: float
) -> float:
    """How often the cycle would close if the first set's measurement were taken at any other places of its groups.

    Zero where each of the three sets holds by itself: then nothing is at stake.
    """
    ab, bc, ac = (candidates[n] for n in cycle)
    if not (ab.objection or bc.objection or ac.objection):
        return 0.0
    claims, medoid = ab.comparison.claims, ab.closure_set.medoid
    rng = np.random.default_rng(len(candidates))
    (poses_a, wander_a), (poses_b, wander_b) = (places[group] for group in (ab.a, ab.b))
    at_a, at_b = rng.integers(0, len(poses_a), RECOMBINED), rng.integers(0, len(poses_b), RECOMBINED)
    same = np.full(RECOMBINED, medoid)
    unrelated = Claims(
        poses_a[at_a], poses_b[at_b], claims.T_a_b[same], claims.covariance[same], wander_a[at_a], wander_b[at_b]
    )
    error, covariance = _closing(
        (unrelated.frames, unrelated.noise, unrelated.wander),
        (bc.frame, bc.noise, bc.wander),
        (ac.frame, ac.noise, ac.wander),
    )
    distances = np.sort(mahalanobis_squared(error, covariance))
    return chance_to_agree(distances, limit, min(len(poses_a), len(poses_b)))
