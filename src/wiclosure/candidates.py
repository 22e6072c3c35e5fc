"""Pairs of keyframes that may see the same place, and where each is predicted to lie from the other."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wiclosure.arrays import FloatArray, IntArray
from wiclosure.evidence import PredictionKind


class RelativePosePredictor(Protocol):
    """Says where keyframes of two robots are, relative to each other."""

    @property
    def kind(self) -> PredictionKind:
        """Whether it tells the poses, or the headings only."""
        ...

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """`T_a_b (M, 4, 4)` of the indexed poses, and its covariances `(M, 6, 6)`."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePairs:
    """Pairs of keyframes of two robots that may see the same place.

    Args:
        robot_a, robot_b: the robots, a before b in the order of the trajectories.
        index_a, index_b: `(M,)` keyframe indices, sorted by a, then b.
        overlap_probability: `(M,)` in [0, 1]; NaN where the filter predicts nothing.
        mahalanobis: `(M,)` Mahalanobis distance of the pair's displacement (paper, eq. 6); NaN likewise.
        predictor: gives the predicted relative poses; None where the filter predicts nothing.
    """

    robot_a: str
    robot_b: str
    index_a: IntArray
    index_b: IntArray
    overlap_probability: FloatArray
    mahalanobis: FloatArray
    predictor: RelativePosePredictor | None = None

    def __post_init__(self) -> None:
        for name in ("index_b", "overlap_probability", "mahalanobis"):
            if getattr(self, name).shape != self.index_a.shape:
                raise ValueError(
                    f"candidate {name} has shape {getattr(self, name).shape}, index_a {self.index_a.shape}"
                )

    def __repr__(self) -> str:
        predicted = "nothing" if self.predicts is None else self.predicts
        return f"CandidatePairs({self.robot_a!r} and {self.robot_b!r}, {len(self)} pairs, {predicted} predicted)"

    def __len__(self) -> int:
        return len(self.index_a)

    @property
    def predicts(self) -> PredictionKind | None:
        """What is predicted of the pairs' relative poses, by the filter or by a robot's own odometry; None: nothing."""
        return None if self.predictor is None else self.predictor.kind

    @classmethod
    def without_prediction(cls, robot_a: str, robot_b: str, index_a: IntArray, index_b: IntArray) -> CandidatePairs:
        """Pairs of which nothing more is known."""
        unknown = np.full(len(index_a), np.nan)
        return cls(robot_a, robot_b, index_a, index_b, unknown, unknown)

    def predicted(self, rows: IntArray) -> tuple[FloatArray, FloatArray] | None:
        """Predicted `T_a_b (K, 4, 4)` and covariances `(K, 6, 6)` of the given rows, or None."""
        if self.predictor is None:
            return None
        return self.predictor.relative_poses(self.robot_a, self.index_a[rows], self.robot_b, self.index_b[rows])


def robot_pairs(robots: list[str]) -> Iterator[tuple[str, str]]:
    """Every pair of different robots, in order."""
    return ((a, b) for i, a in enumerate(robots) for b in robots[i + 1 :])
