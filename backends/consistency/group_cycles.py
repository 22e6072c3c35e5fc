"""Cycles of sets over three groups: those that close support their sets, open ones speak against the weaker."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.sets.candidate_sets import EXPECTED_BY_CHANCE, SATURATED, CandidateSet, Places, least_span
from wiclosure.backends.sets.chance import chance_to_agree
from wiclosure.backends.sets.claims import PAIRS_AT_ONCE, Claims
from wiclosure.types import BoolArray, FloatArray, IntArray

RECOMBINED = 100  # frames tried to see whether chance closes a cycle as well
MOST_CYCLES = 300_000
CYCLES_AT_ONCE = 512  # whose samples are held: bounds memory, and they stay in the cache


@dataclass(frozen=True, eq=False)
class _Frames:
    """Where groups lie in others.

    Args:
        T: `(..., 4, 4)`.
        noise: covariances `(..., 6, 6)` by measurement.
        wander: samples `(..., 6, S)` of the errors by the groups' estimates.
    """

    T: FloatArray
    noise: FloatArray
    wander: FloatArray

    @classmethod
    def of(cls, candidates: Sequence[CandidateSet]) -> _Frames:
        """One for each set."""
        return cls(*(np.stack([getattr(c, name) for c in candidates]) for name in ("frame", "noise", "wander")))

    @classmethod
    def of_medoids(cls, candidates: Sequence[CandidateSet]) -> _Frames:
        """By one closure of each set: less sharp."""
        of = [(c.comparison.claims, c.closure_set.medoid) for c in candidates]
        T, noise = (np.stack([getattr(z, name)[n] for z, n in of]) for name in ("frames", "noise"))
        return cls(T, noise, np.concatenate([z.wander_at(np.array([n])) for z, n in of]))

    def __getitem__(self, rows: IntArray) -> _Frames:
        return _Frames(self.T[rows], self.noise[rows], self.wander[rows])

    @property
    def covariance(self) -> FloatArray:
        """Of all."""
        return np.asarray(self.noise + self.wander @ np.swapaxes(self.wander, -1, -2))


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
    if not len(cycles):
        return
    frames = _Frames.of(candidates)
    closed = _distances(frames, cycles) <= limit
    objected = np.array([bool(c.objection) for c in candidates])
    doubtful = closed & objected[cycles].any(axis=1)  # elsewhere nothing is at stake
    # Large sets are known so well that what linearisation neglects would open their cycles: half closed tells nothing.
    told = (closed | (_distances(_Frames.of_medoids(candidates), cycles) > limit)) & ~doubtful
    told[doubtful] = _chances(candidates, frames, cycles[doubtful], places, limit) <= EXPECTED_BY_CHANCE / len(cycles)
    weights, sizes = (np.array(numbers) for numbers in zip(*((c.weight, len(c)) for c in candidates), strict=True))
    votes = _Votes(cycles[told], closed[told], weights, sizes, objected)
    refuted = votes.refuted(clearly)
    support, contradiction = votes.counted(refuted)
    for candidate, fallen, pro, contra in zip(candidates, refuted, support, contradiction, strict=True):
        candidate.support, candidate.contradiction = float(pro), float(contra)
        if fallen:
            candidate.refutation = "contradicts the closures with other robots, over a third one"


@dataclass(frozen=True, eq=False)
class _Votes:
    """What cycles say of the sets in them.

    Args:
        cycles: `(K, 3)` sets.
        closed: which of the cycles close.
        weight: of the sets.
        size: of the sets, in closures.
        objected: which sets their own pair leaves open.
    """

    cycles: IntArray
    closed: BoolArray
    weight: FloatArray
    size: IntArray
    objected: BoolArray

    def counted(self, refuted: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Support and contradiction of each set; an open cycle says that one of three is wrong, if all three hold."""
        alive = ~refuted[self.cycles].any(axis=1)
        support = self._summed(self.weight, alive & self.closed)
        holding = ~refuted & (~self.objected | (support > 0))
        open_cycles = alive & ~self.closed & holding[self.cycles].all(axis=1)
        return support, self._summed(self.weight + support, open_cycles)

    def refuted(self, clearly: float) -> BoolArray:
        """Sets that fall, the most contradicted first, until more speaks for each than against it."""
        refuted = np.zeros(len(self.weight), bool)
        while True:
            support, contradiction = self.counted(refuted)
            strength = self.weight + support
            contested = contradiction > 0
            if not contested.any():
                return refuted
            worst = int(np.argmax(np.where(contested, contradiction - strength, -np.inf)))
            if contradiction[worst] < clearly * strength[worst]:
                return refuted
            holding = ~refuted & (~self.objected | (support > 0))
            around = (self.cycles == worst).any(axis=1) & ~self.closed & holding[self.cycles].all(axis=1)
            members = np.unique(self.cycles[around])
            refuted[members[self._alike(worst, members, strength)]] = True

    def _alike(self, worst: int, members: IntArray, strength: FloatArray) -> BoolArray:
        """Which members are no stronger than chance makes a right set of as many closures as the smaller one has."""
        smaller = np.clip(self.size[members], SATURATED, max(SATURATED, self.size[worst]))
        shares = np.array([least_span(int(size)) for size in smaller])
        return np.asarray(shares * strength[members] <= strength[worst])

    def _summed(self, strength: FloatArray, chosen: BoolArray) -> FloatArray:
        """By set: over the chosen cycles that it is in, the strength of the weaker of the other two."""
        of_three = strength[self.cycles[chosen]]
        others = np.stack([np.minimum(of_three[:, k - 1], of_three[:, k - 2]) for k in range(3)], axis=1)
        summed = np.bincount(self.cycles[chosen].ravel(), others.ravel(), minlength=len(strength))
        return np.asarray(summed, float)


def _cycles(candidates: Sequence[CandidateSet]) -> IntArray:
    """Triples `(K, 3)` of candidates on the pairs (a, b), (b, c) and (a, c)."""
    by_pair: dict[tuple[int, int], list[int]] = defaultdict(list)
    for n, candidate in enumerate(candidates):
        by_pair[candidate.a, candidate.b].append(n)
    near: dict[int, set[int]] = defaultdict(set)
    for a, b in by_pair:
        near[a].add(b)
    found: list[tuple[int, int, int]] = []
    for a in sorted(near):
        for b, c in combinations(sorted(near[a]), 2):
            if c in near[b]:
                found += [(x, y, z) for x in by_pair[a, b] for y in by_pair[b, c] for z in by_pair[a, c]]
        if len(found) > MOST_CYCLES:
            break
    return np.array(found, np.int64).reshape(-1, 3)


def _distances(frames: _Frames, cycles: IntArray) -> FloatArray:
    """Squared Mahalanobis distance of each cycle from closing."""
    found = [np.zeros(0)]
    for start in range(0, len(cycles), CYCLES_AT_ONCE):
        ab, bc, ac = (frames[n] for n in cycles[start : start + CYCLES_AT_ONCE].T)
        to_c = se3.adjoint(se3.inverse(bc.T))
        wander = to_c @ ab.wander + bc.wander - ac.wander
        noise = se3.rotate_covariance(to_c, ab.noise) + bc.noise + ac.noise
        error = se3.log(se3.between(ac.T, ab.T @ bc.T))
        found.append(mahalanobis_squared(error, _Frames(ac.T, noise, wander).covariance))
    return np.concatenate(found)


def _chances(
    candidates: Sequence[CandidateSet], frames: _Frames, cycles: IntArray, places: Places, limit: float
) -> FloatArray:
    """How often each cycle would close if the first set's measurement were taken at any other places of its groups."""
    chances, covariance = np.zeros(len(cycles)), frames.covariance
    for first in np.unique(cycles[:, 0]):
        rows = np.flatnonzero(cycles[:, 0] == first)
        T_a_b, of_a_b = _elsewhere(candidates[first], places, len(candidates))
        degrees = candidates[first].comparison.claims.degrees
        fewest = min(len(places[group][0]) for group in (candidates[first].a, candidates[first].b))
        for start in range(0, len(rows), PAIRS_AT_ONCE // RECOMBINED):
            part = rows[start : start + PAIRS_AT_ONCE // RECOMBINED]
            bc, ac = cycles[part, 1], cycles[part, 2]
            error = se3.log(se3.between(frames.T[ac][:, None], T_a_b @ frames.T[bc][:, None]).reshape(-1, 4, 4))
            to_c = se3.adjoint(se3.inverse(frames.T[bc]))[:, None]
            spread = to_c @ of_a_b @ np.swapaxes(to_c, -1, -2) + (covariance[bc] + covariance[ac])[:, None]
            distances = mahalanobis_squared(error, spread.reshape(-1, 6, 6)).reshape(len(part), -1)
            ranked = np.sort(distances, axis=1)
            chances[part] = [chance_to_agree(of_cycle, limit, fewest, degrees) for of_cycle in ranked]
    return chances


def _elsewhere(candidate: CandidateSet, places: Places, seed: int) -> tuple[FloatArray, FloatArray]:
    """The set's central measurement, taken at random places: frames `(R, 4, 4)` and their covariances."""
    claims, rng = candidate.comparison.claims, np.random.default_rng(seed)
    (poses_a, wander_a), (poses_b, wander_b) = (places[group] for group in (candidate.a, candidate.b))
    at_a, at_b = rng.integers(0, len(poses_a), RECOMBINED), rng.integers(0, len(poses_b), RECOMBINED)
    same = np.full(RECOMBINED, candidate.closure_set.medoid)
    unrelated = Claims(
        poses_a[at_a], poses_b[at_b], claims.T_a_b[same], claims.covariance[same], wander_a[at_a], wander_b[at_b]
    )
    return unrelated.frames, _Frames(unrelated.frames, unrelated.noise, unrelated.wander).covariance
