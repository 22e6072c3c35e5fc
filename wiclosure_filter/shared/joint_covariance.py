"""Joint covariance of a pose graph of many robots, from the sparse square root of its information.

Nothing of the size of all poses squared is formed: the rows of a robot are computed when they are asked for, and those
of the last robots are kept.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.shared.independent_errors import ErrorSet, IndependentErrors
from wiclosure.wiclosure_filter.shared.square_root import Recent, SquareRoot

# Robots whose rows are kept: those that meet one robot also meet the next, where robots are numbered as they lie.
MOST_KEPT = 32
# Of what systematic errors add to robots: takes longer to compute than the rows, and is asked for three times.
MOST_BYTES = 1 << 30


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariances of K poses of R robots, rotation first.

    Args:
        root: of the information of all poses, each in its own axes.
        first: `(R + 1,)` number of the first pose of each robot, and K.
        turn: `(K, 3, 3)` from each pose's own axes into those that the covariances are wanted in.
        errors: systematic errors that move the poses besides.
    """

    root: SquareRoot
    first: IntArray
    turn: FloatArray
    errors: IndependentErrors = field(default_factory=IndependentErrors)
    _kept: OrderedDict[int, Rows] = field(default_factory=OrderedDict, repr=False)
    _added: Recent[tuple[FloatArray, IntArray]] = field(default_factory=lambda: Recent(MOST_BYTES), repr=False)

    def widened(
        self, sets: Mapping[tuple[int, int], ErrorSet], near: Mapping[int, set[tuple[int, int]]]
    ) -> JointCovariance:
        """With what constant errors add.

        Args:
            sets: by two robots, the errors of their links and odometry.
            near: by robot, whose errors count for it; between two robots count those that count for both.
        """
        errors = IndependentErrors.of(sets, near)
        return replace(self, errors=errors, _kept=OrderedDict(), _added=Recent(MOST_BYTES))

    def of_pairs(self, a: int, n: IntArray, b: int, m: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Covariances `(M, 6, 6)` of poses n of robot a, of these with poses m of robot b, and of the latter."""
        if len(n) == 0:
            return np.zeros((0, 6, 6)), np.zeros((0, 6, 6)), np.zeros((0, 6, 6))
        (rows, of_n), (columns, of_m) = (np.unique(poses, return_inverse=True) for poses in (n, m))
        own_a, cross, own_b = self._rows(a, rows).joint(self._rows(b, columns), slice(0, 6))
        return own_a[of_n], cross[of_n, of_m], own_b[of_m]

    def of_robot(self, robot: int) -> Rows:
        """What all poses of a robot depend on."""
        rows = self._kept.pop(robot, None)
        if rows is None:
            rows = self._rows(robot, np.arange(self.first[robot], self.first[robot + 1]))
        self._kept[robot] = rows
        while len(self._kept) > MOST_KEPT:
            self._kept.popitem(last=False)
        return rows

    def _rows(self, robot: int, poses: IntArray) -> Rows:
        values, places = self.root.rows(poses)
        effects, names = self._effects(robot)
        turn = np.zeros((len(poses), 6, 6))
        turn[:, :3, :3] = turn[:, 3:, 3:] = self.turn[poses]
        return Rows(turn @ values, places, turn @ effects[poses - self.first[robot]], names)

    def _effects(self, robot: int) -> tuple[FloatArray, IntArray]:
        """What systematic errors add to all poses of a robot, and their numbers, see `IndependentErrors.at`."""
        if robot not in self._added:
            poses = np.arange(self.first[robot], self.first[robot + 1])
            found = self.errors.at(robot, self.root, poses)
            self._added.add(robot, found, found[0].nbytes)
        self._added.forget([robot])
        return self._added[robot]


@dataclass(frozen=True, eq=False)
class Rows:
    """What n poses of a robot depend on, as independent numbers of one standard deviation.

    Args:
        values: `(n, 6, 6 C)` of the root's inverse.
        places: `(C,)` which of its columns.
        effects: `(n, 6, E)` of systematic errors.
        names: `(E,)` which of them.
    """

    values: FloatArray
    places: IntArray
    effects: FloatArray
    names: IntArray

    @property
    def own(self) -> FloatArray:
        """`(n, 6, 6)` covariance of each pose."""
        return _squared(self.values) + _squared(self.effects)

    def only(self, poses: slice | int) -> Rows:
        """Those of some of the poses."""
        chosen = slice(poses, poses + 1) if isinstance(poses, int) else poses
        return replace(self, values=self.values[chosen], effects=self.effects[chosen])

    def displacements(self, other: Rows, dimensions: int) -> FloatArray:
        """Covariance `(n, m, d, d)` of the difference of positions, for poses of two robots in common axes."""
        own, cross, others = self.joint(other, slice(3, 3 + dimensions))
        return np.asarray(own[:, None] + others[None, :] - cross - np.swapaxes(cross, 2, 3))

    def joint(self, other: Rows, axes: slice) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Covariances `(n, d, d)`, `(n, m, d, d)`, `(m, d, d)` of and between poses of two robots, some axes of them.

        Systematic errors count where both robots count them: what moves both alike must not count for one.
        """
        _, at, of_other = np.intersect1d(self.names, other.names, assume_unique=True, return_indices=True)
        effects, others = self.effects[:, axes, at], other.effects[:, axes, of_other]
        own_a = _squared(self.values[:, axes]) + _squared(effects)
        own_b = _squared(other.values[:, axes]) + _squared(others)
        _, at, of_other = np.intersect1d(self.places, other.places, assume_unique=True, return_indices=True)
        cross = _times(self._at(axes, at), other._at(axes, of_other)) + _times(effects, others)
        return own_a, cross, own_b

    def _at(self, axes: slice, places: IntArray) -> FloatArray:
        """Values of some axes `(n, d, 6 c)` at some of the places."""
        columns = (6 * places[:, None] + np.arange(6)).ravel()
        return np.asarray(self.values[:, axes][:, :, columns])


def _squared(rows: FloatArray) -> FloatArray:
    return np.asarray(rows @ np.swapaxes(rows, 1, 2))


def _times(rows: FloatArray, others: FloatArray) -> FloatArray:
    """`(n, m, d, d)` products of rows `(n, d, c)` and `(m, d, c)`."""
    (n, d, c), m = rows.shape, len(others)
    return np.asarray((rows.reshape(n * d, c) @ others.reshape(m * d, c).T).reshape(n, d, m, d).swapaxes(1, 2))
