"""What an estimate rests on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.backends.closure_sets import ClosureSet
from wiclosure.backends.estimate.frames import components
from wiclosure.types import BoolArray, RadioLinks, Trajectory


@dataclass(frozen=True, eq=False)
class Measurements:
    """All that was measured on and between robots, but for what is known of the Earth.

    Args:
        trajectories: keyframe odometry by robot; the first robot's frame is the world.
        sets: closures.
        radio: links between robots.
    """

    trajectories: Mapping[str, Trajectory]
    sets: Sequence[ClosureSet]
    radio: Sequence[RadioLinks] = ()

    def among(self, inliers: Sequence[BoolArray]) -> Measurements:
        """With those closures alone that one mask a set names."""
        kept = [closure_set.subset(np.flatnonzero(mask)) for closure_set, mask in zip(self.sets, inliers, strict=True)]
        return replace(self, sets=kept)

    @property
    def closures(self) -> int:
        """How many."""
        return sum(map(len, self.sets))

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Robots that closures or radio connect."""
        return components(list(self.trajectories), self.sets, self.radio)
