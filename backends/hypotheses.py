"""Which hypotheses on pairs of groups hold: each alone, and with those of other pairs over cycles of three."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np

from wiclosure import se3
from wiclosure.backends.alignment import Comparison, Hypothesis
from wiclosure.backends.claims import CHUNK, chance_to_agree
from wiclosure.backends.edges import mahalanobis_squared
from wiclosure.types import FloatArray

SATURATED = 3  # closures beyond which a set is no more certain: one look-alike street yields any number
RECOMBINED = 300  # frames tried to see whether chance closes a cycle as well
MOST_CYCLES = 300_000
EXPECTED_BY_CHANCE = 0.005  # sets that chance would make: one in two hundred graphs without a true closure


@dataclass(eq=False)
class Candidate:
    """A hypothesis on the pair `(a, b)` of groups, and what is known for and against it.

    Args:
        a, b: groups, a < b.
        rows: closures, of all.
        hypothesis, comparison: from `alignment`.
        doubt: why the pair alone does not settle it; empty if it does.
        support, contradiction: of cycles over third groups.
    """

    a: int
    b: int
    rows: np.ndarray
    hypothesis: Hypothesis
    comparison: Comparison
    doubt: str = ""
    support: float = 0.0
    contradiction: float = 0.0
    fallen: str = ""
    frame: FloatArray = field(init=False)
    noise: FloatArray = field(init=False)
    wander: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        claims, medoid = self.comparison.claims, self.hypothesis.medoid
        self.frame, self.noise, self.wander = claims.frames[medoid], claims.noise[medoid], claims.wander[medoid]

    def __len__(self) -> int:
        return len(self.hypothesis)

    @property
    def weight(self) -> float:
        """What it counts for against others."""
        return float(min(len(self), SATURATED))

    @property
    def holds(self) -> bool:
        """Whether it may join its groups."""
        return not self.fallen and (not self.doubt or self.support > 0)


def settle_cycles(candidates: Sequence[Candidate], limit: float) -> None:
    """Closes all cycles of three; sets that more speaks against than for fall, open ones that a cycle closes hold.

    Cycles of an unrelated third set close by chance only; recombined closures tell how often.
    """
    cycles = _cycles(candidates)
    if not cycles:
        return
    closed = _distances(candidates, cycles) <= limit
    telling = np.array([not shut or _telling(candidates, cycle, limit) for cycle, shut in zip(cycles, closed, strict=True)])
    alive = [(cycle, bool(shut)) for cycle, shut, tells in zip(cycles, closed, telling, strict=True) if tells]
    while True:
        _weigh(candidates, alive)
        standing = [c for c in candidates if not c.fallen]
        worst = max(standing, key=lambda c: c.contradiction - c.support - c.weight, default=None)
        if worst is None or worst.contradiction < worst.support + worst.weight:
            return
        excess = worst.contradiction - worst.support - worst.weight
        falling = [c for c in standing if c.contradiction - c.support - c.weight >= excess]
        for candidate in falling:
            candidate.fallen = "contradicts sets of closures with other robots"
        gone = {n for n, c in enumerate(candidates) if c.fallen}
        alive = [(cycle, shut) for cycle, shut in alive if not gone & set(cycle)]


def _weigh(candidates: Sequence[Candidate], alive: Sequence[tuple[tuple[int, int, int], bool]]) -> None:
    """What closed and open cycles say; an open one says that one of three is wrong, if all three hold otherwise."""
    for candidate in candidates:
        candidate.support = candidate.contradiction = 0.0
    for cycle, shut in alive:
        for n in cycle if shut else ():
            candidates[n].support += min(candidates[m].weight for m in cycle if m != n)
    holding = [candidate.holds for candidate in candidates]
    for cycle, shut in alive:
        for n in cycle if not shut and all(holding[m] for m in cycle) else ():
            candidates[n].contradiction += min(candidates[m].weight + candidates[m].support for m in cycle if m != n)


def _cycles(candidates: Sequence[Candidate]) -> list[tuple[int, int, int]]:
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


def _distances(candidates: Sequence[Candidate], cycles: Sequence[tuple[int, int, int]]) -> FloatArray:
    """Squared Mahalanobis distance of each cycle from closing."""
    frames, noises, wanders = (np.stack([getattr(c, name) for c in candidates]) for name in ("frame", "noise", "wander"))
    index = np.array(cycles)
    found = []
    for start in range(0, len(index), CHUNK):
        ab, bc, ac = index[start : start + CHUNK].T
        error, covariance = _closing(
            (frames[ab], noises[ab], wanders[ab]), (frames[bc], noises[bc], wanders[bc]), (frames[ac], noises[ac], wanders[ac])
        )
        found.append(mahalanobis_squared(error, covariance))
    return np.concatenate(found)


Frame = tuple[FloatArray, FloatArray, FloatArray]


def _closing(ab: Frame, bc: Frame, ac: Frame) -> tuple[FloatArray, FloatArray]:
    """Errors `(M, 6)` of cycles in the third group's frame, and covariances."""
    error = se3.log(se3.between(ac[0], ab[0] @ bc[0]))
    to_c = se3.adjoint(se3.inverse(bc[0]))
    wander = to_c @ ab[2] + bc[2] - ac[2]
    covariance = se3.rotate_covariance(to_c, ab[1]) + bc[1] + ac[1] + wander @ np.swapaxes(wander, -1, -2)
    return error, covariance


def _telling(candidates: Sequence[Candidate], cycle: tuple[int, int, int], limit: float) -> bool:
    """Whether closures recombined on the first pair would hardly ever close the cycle."""
    ab, bc, ac = (candidates[n] for n in cycle)
    claims = ab.comparison.claims
    n = len(claims)
    rng = np.random.default_rng(n)
    first, second = rng.integers(0, n, (2, RECOMBINED))
    apart = first != second
    if not apart.any():
        return False
    unrelated = claims.recombined(first[apart], second[apart])
    error, covariance = _closing(
        (unrelated.frames, unrelated.noise, unrelated.wander), (bc.frame, bc.noise, bc.wander), (ac.frame, ac.noise, ac.wander)
    )
    distances = np.sort(mahalanobis_squared(error, covariance))
    return chance_to_agree(distances, limit, n) <= 0.05
