"""Alternative estimates where a few alignments are likely: pairs that are possible under any of them.

The paper's filter has one alignment or none.  A handful of measurements often leaves two or three, metres apart, of
which one is right; each of them rules out most pairs, and what all of them rule out cannot overlap.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, IntArray, PredictionKind
from wiclosure.wiclosure_filter.search.gates import Gate
from wiclosure.wiclosure_filter.search.pair_model import PairModel
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedEstimate


@dataclass(frozen=True, eq=False)
class AlternativeEstimates:
    """Estimates of the same two trajectories, one for each likely alignment.

    Implements `wiclosure.types.RelativePosePredictor`.

    Args:
        estimates: two or more, the most likely first.
        gate: tells how probably a pair overlaps under each of them.
    """

    estimates: tuple[SharedEstimate, ...]
    gate: Gate
    kind: ClassVar[PredictionKind] = PredictionKind.POSE

    @classmethod
    def of(
        cls, alignment: FrameAlignment, estimate: Callable[[FrameAlignment], SharedEstimate | None], gate: Gate
    ) -> AlternativeEstimates | None:
        """One estimate for each of the likely alignments; None where they are not few, or one allows no estimate.

        Args:
            alignment: of two robots.
            estimate: shares their trajectories by an alignment that is taken for certain.
            gate: see above.
        """
        if alignment.best is None or not alignment.likely_alternatives:
            return None
        estimates = []
        for hypothesis in (alignment.best, *alignment.likely_alternatives):
            found = estimate(replace(alignment, best=hypothesis, ambiguous=False))
            if found is None:
                return None
            estimates.append(found)
        return cls(tuple(estimates), gate)

    @property
    def alternatives(self) -> int:
        """How many alignments are likely."""
        return len(self.estimates)

    def models(self, robot_a: str, robot_b: str, gate: Gate | None = None) -> tuple[PairModel, ...]:
        """Those of all estimates, the most likely one's first; each answers for every pair."""
        return tuple(model for estimate in self.estimates for model in estimate.models(robot_a, robot_b, gate))

    def rank(self, robot: str) -> int:
        """See `SharedEstimate`."""
        return 0

    def may_meet(self, gate: Gate) -> set[tuple[str, str]]:
        """Under any of the estimates."""
        return set().union(*(estimate.may_meet(gate) for estimate in self.estimates))

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """`T_a_b (M, 4, 4)` and covariances `(M, 6, 6)`, by the alignment under which each pair most probably overlaps.

        The covariance covers how far off the others are.  If the pair does overlap, then an alignment is right in
        proportion to the probability that it gives to that.  Odds between the alignments do not enter: they rest on the
        few measurements that could not decide.  Their mean would be a pose that none of them predicts, and a
        registration that starts there ends at neither.
        """
        predicted = [e.relative_poses(robot_a, index_a, robot_b, index_b) for e in self.estimates]
        T, C = (np.stack(of_each) for of_each in zip(*predicted, strict=True))
        weight = np.stack([self.overlap_probability(e, robot_a, index_a, robot_b, index_b) for e in self.estimates])
        weight = np.where(weight.sum(axis=0) > 0, weight, 1.0)
        weight /= weight.sum(axis=0)
        T_probable = T[np.argmax(weight, axis=0), np.arange(len(index_a))]
        off = se3.log(se3.between(np.broadcast_to(T_probable, T.shape), T))
        spread = np.einsum("hm,hmi,hmj->mij", weight, off, off)
        return T_probable, np.einsum("hm,hmij->mij", weight, C) + spread

    def overlap_probability(
        self, estimate: SharedEstimate, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> FloatArray:
        """Probability `(M,)` of overlap under one of the estimates; 0 where its gate does not keep the pair."""
        probability = np.zeros(len(index_a))
        for model in estimate.models(robot_a, robot_b):
            p, k = index_a - model.first[0], index_b - model.first[1]
            there = (p >= 0) & (p < len(model.a)) & (k >= 0) & (k < len(model.b))
            rows = np.flatnonzero(there)
            rows = rows[model.applies(p[rows], k[rows])]
            p, k = p[rows], k[rows]
            scores = self.gate.score(model.displacement(p, k), model.covariance(p, k))
            probability[rows[scores.keep]] = scores.overlap_probability
        return probability
