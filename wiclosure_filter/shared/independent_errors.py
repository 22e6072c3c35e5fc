"""Constant errors that move a whole joint estimate: what they add near the robots that they belong to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.shared.square_root import SquareRoot

# Of an independent error's effect: what adds less than this share to the variance of whatever there is, is left out.
LEAST_SHARE = 1e-6


@dataclass(frozen=True, eq=False)
class ErrorSet:
    """The errors of two robots, as p independent combinations of one standard deviation each.

    Args:
        places: `(c,)` columns of the root's inverse by which they move poses.
        effects: `(c, 6, p)` how much of each.
    """

    places: IntArray
    effects: FloatArray

    @classmethod
    def of(cls, places: IntArray, effects: FloatArray, covariance: FloatArray) -> ErrorSet:
        """From effects `(c, 6, e)` of e errors with a covariance; tiny combinations, and tiny parts, are left out."""
        mixed = effects.reshape(6 * len(places), len(covariance)) @ np.linalg.cholesky(covariance)
        left, sizes, _ = np.linalg.svd(mixed, full_matrices=False)
        large = sizes**2 > LEAST_SHARE
        combined = (left * sizes)[:, large].reshape(len(places), 6, int(large.sum()))
        size = np.sum(combined**2, axis=(1, 2))
        order = np.argsort(size)
        kept = np.sort(order[np.cumsum(size[order]) > LEAST_SHARE])
        return cls(places[kept], combined[kept])

    def __len__(self) -> int:
        return int(self.effects.shape[2])


@dataclass(frozen=True, eq=False)
class IndependentErrors:
    """Sets of errors that are independent of each other.

    Args:
        sets: one for each two robots whose links or odometry err.
        near: by robot, the sets that count for it, increasing.
    """

    sets: tuple[ErrorSet, ...] = ()
    near: Mapping[int, tuple[int, ...]] = field(default_factory=dict)

    @cached_property
    def begin(self) -> IntArray:
        """`(S + 1,)` number of the first error of each set."""
        return np.cumsum([0, *(len(one) for one in self.sets)])

    @classmethod
    def of(
        cls, sets: Mapping[tuple[int, int], ErrorSet], near: Mapping[int, set[tuple[int, int]]]
    ) -> IndependentErrors:
        """See `JointCovariance.widened`."""
        counted = {robot: tuple(i for i, pair in enumerate(sets) if pair in pairs) for robot, pairs in near.items()}
        return cls(tuple(sets.values()), counted)

    def at(self, robot: int, root: SquareRoot, poses: IntArray) -> tuple[FloatArray, IntArray]:
        """What the errors that count for a robot add to poses `(n, 6, E)` of it, and their numbers `(E,)`, increasing.

        Args:
            robot: the robot.
            root: of the information of all poses.
            poses: `(n,)` numbers of those of the robot.
        """
        near = self.near.get(robot, ())
        places = root.with_ancestors(poses)
        moved = np.zeros((len(places), 6, sum(len(self.sets[one]) for one in near)))
        names, column = [np.zeros(0, np.int64)], 0
        for one in near:
            own = self.sets[one]
            _, at, of_error = np.intersect1d(places, own.places, assume_unique=True, return_indices=True)
            moved[at, :, column : column + len(own)] = own.effects[of_error]
            names.append(np.arange(self.begin[one], self.begin[one + 1]))
            column += len(own)
        return root.following(poses, moved, places), np.concatenate(names)
