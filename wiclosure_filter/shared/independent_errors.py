"""Constant errors that move a whole joint estimate: what they add near the robots that they belong to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from wiclosure.types import FloatArray, IntArray

# Of an independent error's effect: what adds less than this share to the variance of whatever there is, is left out.
LEAST_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class ErrorSet:
    """The errors of two robots, as p independent combinations of one standard deviation each.

    Args:
        places: `(c,)` columns of the root's inverse that the pulls at linked poses touch.
        effects: `(6 c, p)` by how much.
        direct: by robot, what moves its poses besides, `(n, 6, p)` in their own axes: a scaled odometry.
    """

    places: IntArray
    effects: FloatArray
    direct: Mapping[int, FloatArray] = field(default_factory=dict)

    @classmethod
    def of(
        cls, places: IntArray, effects: FloatArray, direct: Mapping[int, FloatArray], covariance: FloatArray
    ) -> ErrorSet:
        """From effects `(c, 6, e)` and direct ones of e errors with a covariance; tiny combinations are left out."""
        mixing = np.linalg.cholesky(covariance)
        mixed = effects.reshape(6 * len(places), len(mixing)) @ mixing
        moved = {robot: own @ mixing for robot, own in direct.items()}
        if not moved:
            left, sizes, _ = np.linalg.svd(mixed, full_matrices=False)
            mixed = (left * sizes)[:, sizes**2 > LEAST_SHARE]
        return cls(places, mixed, moved)

    def __len__(self) -> int:
        return int(self.effects.shape[1])


@dataclass(frozen=True, eq=False)
class IndependentErrors:
    """Sets of errors that are independent of each other.

    Args:
        sets: one for each two robots whose links or odometry err.
        near: by robot, the sets that count for it, increasing.
    """

    sets: tuple[ErrorSet, ...] = ()
    near: Mapping[int, tuple[int, ...]] = field(default_factory=dict)

    @classmethod
    def of(
        cls, sets: Mapping[tuple[int, int], ErrorSet], near: Mapping[int, set[tuple[int, int]]]
    ) -> IndependentErrors:
        """See `JointCovariance.widened`."""
        counted = {robot: tuple(i for i, pair in enumerate(sets) if pair in pairs) for robot, pairs in near.items()}
        return cls(tuple(sets.values()), counted)

    def at(self, robot: int, poses: IntArray, values: FloatArray, places: IntArray) -> tuple[FloatArray, IntArray]:
        """What the errors that count for a robot add to its poses `(n, 6, E)`, and their numbers `(E,)`, increasing.

        Args:
            robot: the robot.
            poses: `(n,)` which of its poses, from 0.
            values: `(n, 6, 6 C)` rows of the root's inverse.
            places: `(C,)` of their columns.
        """
        sets = self.near.get(robot, ())
        begin = np.cumsum([0, *(len(one) for one in self.sets)])
        names = np.concatenate([np.zeros(0, np.int64), *(np.arange(begin[one], begin[one + 1]) for one in sets)])
        moved = np.zeros((len(places), 6, len(names)))
        direct = np.zeros((len(poses), 6, len(names)))
        for one in sets:
            own = self.sets[one]
            _, at, of_error = np.intersect1d(places, own.places, assume_unique=True, return_indices=True)
            columns = slice(*np.searchsorted(names, (begin[one], begin[one + 1])))
            moved[at, :, columns] = own.effects.reshape(-1, 6, len(own))[of_error]
            if robot in own.direct:
                direct[:, :, columns] = own.direct[robot][poses]
        return values @ moved.reshape(6 * len(places), len(names)) + direct, names
