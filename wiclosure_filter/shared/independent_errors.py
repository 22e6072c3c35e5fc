"""Systematic errors of links that move a whole joint estimate: what they add near the robots that they belong to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.shared.square_root import SquareRoot

# Of an independent error's effect: what adds less than this share to the variance of whatever there is, is left out.
LEAST_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class IndependentErrors:
    """Errors of one standard deviation each, in sets: one for the links of two robots.

    Args:
        places: of each set, the columns `(c,)` of the root's inverse that it touches.
        effects: of each set, `(6 c, p)` by how much, in independent combinations of the errors.
        near: by robot, the sets that count for it, increasing.
    """

    places: tuple[IntArray, ...] = ()
    effects: tuple[FloatArray, ...] = ()
    near: Mapping[int, tuple[int, ...]] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        root: SquareRoot,
        pulls: Mapping[tuple[int, int], Mapping[int, FloatArray]],
        near: Mapping[int, set[tuple[int, int]]],
    ) -> IndependentErrors:
        """See `JointCovariance.widened`."""
        places, effects = [], []
        for of_poses in pulls.values():
            solved, touched = root.solved(np.array(list(of_poses)), np.array(list(of_poses.values())))
            left, sizes, _ = np.linalg.svd(solved.reshape(6 * len(touched), -1), full_matrices=False)
            places.append(touched)
            effects.append((left * sizes)[:, sizes**2 > LEAST_SHARE])
        counted = {robot: tuple(i for i, pair in enumerate(pulls) if pair in pairs) for robot, pairs in near.items()}
        return cls(tuple(places), tuple(effects), counted)

    def at(self, robot: int, values: FloatArray, places: IntArray) -> tuple[FloatArray, IntArray]:
        """What the errors that count for a robot add to its poses `(n, 6, E)`, and their numbers `(E,)`, increasing.

        Args:
            robot: the robot.
            values: `(n, 6, 6 C)` rows of the root's inverse.
            places: `(C,)` of their columns.
        """
        sets = self.near.get(robot, ())
        begin = np.cumsum([0, *(effect.shape[1] for effect in self.effects)])
        names = np.concatenate([np.zeros(0, np.int64), *(np.arange(begin[one], begin[one + 1]) for one in sets)])
        moved = np.zeros((len(places), 6, len(names)))
        for one in sets:
            _, at, of_error = np.intersect1d(places, self.places[one], assume_unique=True, return_indices=True)
            first, end = np.searchsorted(names, (begin[one], begin[one + 1]))
            moved[at, :, first:end] = self.effects[one].reshape(-1, 6, end - first)[of_error]
        return values @ moved.reshape(6 * len(places), len(names)), names
