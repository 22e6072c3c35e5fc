"""Systematic errors of links that move a whole joint estimate: what they add near the robots that they belong to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.shared.square_root import SquareRoot


@dataclass(frozen=True, eq=False)
class IndependentErrors:
    """Errors of one standard deviation each, in sets of p: one set for the links of two robots.

    Args:
        places: of each set, the columns `(c,)` of the root's inverse that it touches.
        effects: of each set, `(6 c, p)` by how much.
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
            rows, touched = root.rows(np.array(list(of_poses)))
            places.append(touched)
            effects.append(np.einsum("tic,tip->cp", rows, np.array(list(of_poses.values())), optimize=True))
        counted = {robot: tuple(i for i, pair in enumerate(pulls) if pair in pairs) for robot, pairs in near.items()}
        return cls(tuple(places), tuple(effects), counted)

    def at(self, robot: int, values: FloatArray, places: IntArray) -> tuple[FloatArray, IntArray]:
        """What the errors that count for a robot add to its poses `(n, 6, E)`, and the errors' numbers `(E,)`.

        Args:
            robot: the robot.
            values: `(n, 6, 6 C)` rows of the root's inverse.
            places: `(C,)` of their columns.
        """
        sets = self.near.get(robot, ())
        count = self.effects[0].shape[1] if self.effects else 0
        moved = np.zeros((len(places), 6, len(sets) * count))
        for number, one in enumerate(sets):
            _, at, of_error = np.intersect1d(places, self.places[one], assume_unique=True, return_indices=True)
            effect = self.effects[one].reshape(-1, 6, count)
            moved[at, :, number * count : (number + 1) * count] = effect[of_error]
        names = (np.array(sets, np.int64)[:, None] * count + np.arange(count)).ravel()
        return values @ moved.reshape(6 * len(places), len(names)), names
