"""Joint covariance of a pose graph of many robots, from the sparse square root of its information.

Nothing of the size of all poses squared is formed: the rows of a robot are computed when they are asked for, and those
of the last robots are kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.covariance.recent import Recent
from wiclosure.wiclosure_filter.covariance.square_root import SquareRoot

MOST_BYTES = 1 << 29  # of rows that are kept: of robots that lie near each other


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariances of K poses of R robots, rotation first.

    Args:
        root: of the information of all poses, each in its own axes.
        first: `(R + 1,)` number of the first pose of each robot, and K.
        turn: `(K, 3, 3)` from each pose's own axes into those that the covariances are wanted in.
        linked: `(L,)` poses of one robot, and those of others that factors join them with: asked for more cheaply.
    """

    root: SquareRoot
    first: IntArray
    turn: FloatArray
    linked: tuple[IntArray, IntArray]
    _kept: Recent[Rows] = field(default_factory=lambda: Recent(MOST_BYTES), repr=False)
    _cross: dict[tuple[int, int], FloatArray] = field(default_factory=dict, repr=False)

    def of_pairs(self, n: IntArray, m: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Covariances `(M, 6, 6)` of poses n of one robot, of these with poses m of another, and of the latter."""
        cross = self._of_linked(n, m)
        others = np.flatnonzero(np.isnan(cross[:, 0, 0]))
        if len(others):
            (rows, of_n), (columns, of_m) = (np.unique(poses[others], return_inverse=True) for poses in (n, m))
            cross[others] = self._rows(rows).cross(self._rows(columns))[of_n, of_m]
        return self._alone(n), cross, self._alone(m)

    def about(self, robots: Sequence[int], ones: Sequence[int]) -> list[tuple[FloatArray, FloatArray]]:
        """For each of some robots covariances `(n, 6, 6)` of all its poses, and of these with one of them.

        Args:
            robots: that lie near each other, for speed.
            ones: which pose of each robot.
        """
        poses = [np.arange(self.first[robot], self.first[robot + 1]) for robot in robots]
        middles = np.array([own[one] for own, one in zip(poses, ones, strict=True)])
        turned = zip(poses, self._turn(middles), self.root.with_ones(poses, middles), strict=True)
        return [(self._alone(own), self._turn(own) @ columns @ turn.T) for own, turn, columns in turned]

    def learn(self, n: IntArray, others: Sequence[IntArray]) -> None:
        """Computes the covariances of some poses with others together, before `of_two` is asked for them.

        Args:
            n: `(G,)`, in an order in which neighbours follow each other.
            others: for each, other poses.
        """
        for own, blocks, with_one in zip(n.tolist(), self.root.with_ones(others, n), others, strict=True):
            self._cross.update(((own, other), block.T) for other, block in zip(with_one.tolist(), blocks, strict=True))

    def of_two(self, n: int, m: int) -> FloatArray:
        """Covariance `(12, 12)` of two poses."""
        if (n, m) not in self._cross:
            self.learn(np.array([n]), [np.array([m])])
        turn = self._turn(np.array([n, m]))
        cross = turn[0] @ self._cross[n, m] @ turn[1].T
        own_n, own_m = self._alone(np.array([n, m]))
        return np.block([[own_n, cross], [cross.T, own_m]])

    def positions(self, robot: int, dimensions: int) -> Rows:
        """What the positions of all poses of a robot depend on, horizontal ones or in space."""

        def rows() -> tuple[Rows, int]:
            poses = np.arange(self.first[robot], self.first[robot + 1])
            found = self._asked(poses, self._turn(poses)[:, 3 : 3 + dimensions])
            return found, found.values.nbytes

        return self._kept.reuse((robot, dimensions), rows)

    def _rows(self, poses: IntArray) -> Rows:
        return self._asked(poses, self._turn(poses))

    def _asked(self, poses: IntArray, parts: FloatArray) -> Rows:
        values, cliques = self.root.rows(poses, parts)
        own = parts @ self._own[poses] @ np.swapaxes(parts, 1, 2)
        return Rows(values, cliques, 6 * self.root.lengths(cliques), own)

    def _alone(self, poses: IntArray) -> FloatArray:
        turn = self._turn(poses)
        return np.asarray(turn @ self._own[poses] @ np.swapaxes(turn, 1, 2))

    def _of_linked(self, n: IntArray, m: IntArray) -> FloatArray:
        """Covariances `(M, 6, 6)` of poses n with m, of those that are linked; NaN of others."""
        linked, size = self._numbers, len(self.turn)
        if len(linked) == 0:
            return np.full((len(n), 6, 6), np.nan)
        place = np.minimum(np.searchsorted(linked, n * size + m), len(linked) - 1)
        found = np.where((linked[place] == n * size + m)[:, None, None], self._near[1][place], np.nan)
        return np.asarray(self._turn(n) @ found @ np.swapaxes(self._turn(m), 1, 2))

    @cached_property
    def _numbers(self) -> IntArray:
        """Of linked pairs of poses, increasing."""
        n, m = self.linked
        return np.unique(n * len(self.turn) + m)

    @cached_property
    def _near(self) -> tuple[FloatArray, FloatArray]:
        """Covariance of each pose, and of linked ones."""
        return self.root.near(*np.divmod(self._numbers, len(self.turn)))

    @property
    def _own(self) -> FloatArray:
        return self._near[0]

    def _turn(self, poses: IntArray) -> FloatArray:
        turn = np.zeros((len(poses), 6, 6))
        turn[:, :3, :3] = turn[:, 3:, 3:] = self.turn[poses]
        return turn


@dataclass(frozen=True, eq=False)
class Rows:
    """What n poses of a robot, or d parts of each, depend on, as independent numbers of one standard deviation.

    Args:
        values: `(C, n, d)` of the root's inverse.
        cliques: `(c,)` which of its columns, increasing.
        lengths: `(c,)` how many columns each of them is.
        own: `(n, d, d)` covariance of each pose.
    """

    values: FloatArray
    cliques: IntArray
    lengths: IntArray
    own: FloatArray

    def only(self, poses: slice) -> Rows:
        """Those of some of the poses."""
        return Rows(self.values[:, poses], self.cliques, self.lengths, self.own[poses])

    def displacements(self, other: Rows) -> FloatArray:
        """Covariance `(n, m, d, d)` of the difference of positions, for poses of two robots in common axes."""
        cross = self.cross(other)
        return np.asarray(self.own[:, None] + other.own[None, :] - cross - np.swapaxes(cross, 2, 3))

    def cross(self, other: Rows) -> FloatArray:
        """Covariance `(n, m, d, d)` between two robots' poses."""
        (_, n, d), (_, m, e) = self.values.shape, other.values.shape
        product = np.zeros((n * d, m * e))
        for own, of_other in zip(self._runs(other), other._runs(self), strict=True):
            product += self.values[own].reshape(-1, n * d).T @ other.values[of_other].reshape(-1, m * e)
        return np.asarray(product.reshape(n, d, m, e).swapaxes(1, 2))

    def _runs(self, other: Rows) -> list[slice]:
        """Where columns are that both have, in stretches that are one piece in both: no copies of them are needed."""
        _, here, there = np.intersect1d(self.cliques, other.cliques, assume_unique=True, return_indices=True)
        ends = np.concatenate([[0], np.cumsum(self.lengths)])
        breaks = np.flatnonzero((np.diff(here) > 1) | (np.diff(there) > 1)) + 1
        runs = np.split(here, breaks)
        return [slice(int(ends[run[0]]), int(ends[run[-1] + 1])) for run in runs if len(run)]
