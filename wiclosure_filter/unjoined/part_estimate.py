"""An estimate of stretches of two trajectories, numbered as the keyframes of the whole ones are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from wiclosure.types import FloatArray, IntArray, PredictionKind
from wiclosure.wiclosure_filter.likelihood.frame_prior import UNKNOWN_M, UNKNOWN_RAD
from wiclosure.wiclosure_filter.search.gates import Gate
from wiclosure.wiclosure_filter.search.pair_model import PairModel
from wiclosure.wiclosure_filter.shared.shared_trajectory import SharedEstimate

_UNKNOWN = np.diag([UNKNOWN_RAD**2] * 3 + [UNKNOWN_M**2] * 3)


@dataclass(frozen=True, eq=False)
class PartEstimate:
    """What joins a stretch of one trajectory with a stretch of another; of other keyframes it tells nothing.

    Implements `SharedEstimate`.

    Args:
        estimate: of the stretches.
        stretch: keyframes of each robot.
    """

    estimate: SharedEstimate
    stretch: Mapping[str, range]
    kind: ClassVar[PredictionKind] = PredictionKind.POSE

    @property
    def alternatives(self) -> int:
        """See `SharedEstimate`."""
        return self.estimate.alternatives

    def models(self, robot_a: str, robot_b: str, gate: Gate | None = None) -> tuple[PairModel, ...]:
        """See `SharedEstimate`."""
        start_a, start_b = self.stretch[robot_a].start, self.stretch[robot_b].start
        return tuple(
            replace(model, first=(model.first[0] + start_a, model.first[1] + start_b))
            for model in self.estimate.models(robot_a, robot_b, gate)
        )

    def may_meet(self, gate: Gate) -> set[tuple[str, str]]:
        """See `SharedEstimate`."""
        return self.estimate.may_meet(gate)

    def rank(self, robot: str) -> int:
        """See `SharedEstimate`."""
        return self.estimate.rank(robot)

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """`T_a_b (M, 4, 4)` and covariances `(M, 6, 6)`; of other keyframes that of the nearest ones, as unknown."""
        known = np.ones(len(index_a), bool)
        inside = []
        for robot, index in ((robot_a, index_a), (robot_b, index_b)):
            stretch = self.stretch[robot]
            nearest = np.clip(index, stretch.start, stretch.stop - 1)
            known &= nearest == index
            inside.append(nearest - stretch.start)
        T_a_b, covariance = self.estimate.relative_poses(robot_a, inside[0], robot_b, inside[1])
        return T_a_b, np.where(known[:, None, None], covariance, covariance + _UNKNOWN)
