"""Joint covariance of a pose graph of many robots, from the sparse square root of its information.

Nothing of the size of all poses squared is formed: the rows of a robot are computed when they are asked for, and those
of the last robots are kept.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.shared.square_root import SquareRoot

# Robots whose rows are kept: those that meet one robot also meet the next, where robots are numbered as they lie.
MOST_KEPT = 32


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariances of K poses of R robots, rotation first.

    Args:
        root: of the information of all poses, each in its own axes.
        first: `(R + 1,)` number of the first pose of each robot, and K.
        turn: `(K, 3, 3)` from each pose's own axes into those that the covariances are wanted in.
    """

    root: SquareRoot
    first: IntArray
    turn: FloatArray
    _kept: OrderedDict[int, Rows] = field(default_factory=OrderedDict, repr=False)

    def of_pairs(self, n: IntArray, m: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Covariances `(M, 6, 6)` of poses n of one robot, of these with poses m of another, and of the latter."""
        if len(n) == 0:
            return np.zeros((0, 6, 6)), np.zeros((0, 6, 6)), np.zeros((0, 6, 6))
        (rows, of_n), (columns, of_m) = (np.unique(poses, return_inverse=True) for poses in (n, m))
        own_a, cross, own_b = self._rows(rows).joint(self._rows(columns))
        return own_a[of_n], cross[of_n, of_m], own_b[of_m]

    def about(self, robot: int, one: int) -> tuple[FloatArray, FloatArray]:
        """Covariances `(n, 6, 6)` of all poses of a robot, and of these with one of them."""
        poses = np.arange(self.first[robot], self.first[robot + 1])
        turn = self._turn(poses)
        with_one = turn @ self.root.with_one(poses, int(poses[one])) @ turn[one].T
        return turn @ self._own[poses] @ np.swapaxes(turn, 1, 2), with_one

    @cached_property
    def _own(self) -> FloatArray:
        return self.root.chains()[0]

    def positions(self, robot: int, dimensions: int) -> Rows:
        """What the positions of all poses of a robot depend on, horizontal ones or in space."""
        rows = self._kept.pop(robot, None)
        if rows is None:
            poses = np.arange(self.first[robot], self.first[robot + 1])
            values, places = self.root.rows(poses)
            rows = Rows(self.turn[poses, :dimensions] @ values[:, 3:], places)
        self._kept[robot] = rows
        while len(self._kept) > MOST_KEPT:
            self._kept.popitem(last=False)
        return rows

    def _rows(self, poses: IntArray) -> Rows:
        values, places = self.root.rows(poses)
        return Rows(self._turn(poses) @ values, places)

    def _turn(self, poses: IntArray) -> FloatArray:
        turn = np.zeros((len(poses), 6, 6))
        turn[:, :3, :3] = turn[:, 3:, 3:] = self.turn[poses]
        return turn


@dataclass(frozen=True, eq=False)
class Rows:
    """What n poses of a robot, or some axes of them, depend on, as independent numbers of one standard deviation.

    Args:
        values: `(n, d, 6 C)` of the root's inverse.
        places: `(C,)` which of its columns.
    """

    values: FloatArray
    places: IntArray

    def only(self, poses: slice) -> Rows:
        """Those of some of the poses."""
        return replace(self, values=self.values[poses])

    def displacements(self, other: Rows) -> FloatArray:
        """Covariance `(n, m, d, d)` of the difference of positions, for poses of two robots in common axes."""
        own, cross, others = self.joint(other)
        return np.asarray(own[:, None] + others[None, :] - cross - np.swapaxes(cross, 2, 3))

    def joint(self, other: Rows) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Covariances `(n, d, d)`, `(n, m, d, d)`, `(m, d, d)` of and between two robots' poses."""
        _, at, of_other = np.intersect1d(self.places, other.places, assume_unique=True, return_indices=True)
        return _squared(self.values), _times(self._at(at), other._at(of_other)), _squared(other.values)

    def _at(self, places: IntArray) -> FloatArray:
        """Values `(n, d, 6 c)` at some of the places."""
        n, d, _ = self.values.shape
        return self.values.reshape(n, d, -1, 6)[:, :, places].reshape(n, d, -1)


def _squared(rows: FloatArray) -> FloatArray:
    return np.asarray(rows @ np.swapaxes(rows, 1, 2))


def _times(rows: FloatArray, others: FloatArray) -> FloatArray:
    """`(n, m, d, d)` products of rows `(n, d, c)` and `(m, d, c)`."""
    (n, d, c), m = rows.shape, len(others)
    return np.asarray((rows.reshape(n * d, c) @ others.reshape(m * d, c).T).reshape(n, d, m, d).swapaxes(1, 2))
