"""What is predicted of two robots' keyframes, in the form that gates and overlap search need.

The displacement of keyframe k of robot b from keyframe p of robot a is Gaussian with

    mean        positions_b[k] - positions_a[p]
    covariance  C(p, k) + own_a[p] + own_b[k]

where C comes from a table that is much coarser than the keyframes: rows are *nodes* of a, columns nodes of b, and each
keyframe lies between two nodes.  C(p, k) blends the four entries around it with weights that sum to one.  Since a
blend of covariances is no larger than the largest, and its `det^(1/d)` no smaller than the smallest, the extremes over
a rectangle of the table bound all pairs of two segments.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.search.gates import spread


@dataclass(frozen=True, eq=False)
class KeyframePlaces:
    """Where the keyframes of one robot are, and between which nodes.

    Args:
        positions: `(N, d)` in the shared frame, metres.
        own_covariance: `(N, d, d)` m^2, what the nodes do not explain.
        node: `(N,)` the node before each keyframe, increasing.
        fraction: `(N,)` weight of the node after it, in [0, 1], increasing between two nodes; 0 where there is none.
    """

    positions: FloatArray
    own_covariance: FloatArray
    node: IntArray
    fraction: FloatArray

    def __len__(self) -> int:
        return len(self.positions)

    def stretch(self, keyframes: slice) -> tuple[KeyframePlaces, slice]:
        """Successive keyframes of these, and the nodes that they lie between."""
        node = self.node[keyframes]
        nodes = slice(int(node[0]), int(node[-1]) + 2)
        places = KeyframePlaces(
            self.positions[keyframes], self.own_covariance[keyframes], node - nodes.start, self.fraction[keyframes]
        )
        return places, nodes

    @cached_property
    def own_variance(self) -> FloatArray:
        """`(N,)` m^2, largest variance of `own_covariance` in any direction."""
        return spread(self.own_covariance)[0]


@dataclass(frozen=True, eq=False)
class PairModel:
    """Predicted displacements between all keyframes of two robots.

    Args:
        a, b: the keyframes.
        table: `(nodes of a, nodes of b, d, d)` covariance of the displacement between nodes, m^2.
        routes: None, or the routes over all links of the robots, where this model answers only for pairs whose
            shortest route leads over its own link (paper mode).
        first: which keyframes of the robots the first ones of a and b are.
    """

    a: KeyframePlaces
    b: KeyframePlaces
    table: FloatArray
    routes: ShortestRoutes | None = None
    first: tuple[int, int] = (0, 0)

    def displacement(self, p: IntArray, k: IntArray) -> FloatArray:
        """Means `(M, d)` for pairs of keyframes."""
        return self.b.positions[k] - self.a.positions[p]

    def covariance(self, p: IntArray, k: IntArray) -> FloatArray:
        """Covariances `(M, d, d)` for pairs of keyframes."""
        d = self.table.shape[-1]
        covariance = self.a.own_covariance[p] + self.b.own_covariance[k]
        for i in range(d):
            for j in range(i, d):
                covariance[:, i, j] += self._blended(self.table[:, :, i, j], p, k)
                covariance[:, j, i] = covariance[:, i, j]
        return covariance

    def applies(self, p: IntArray, k: IntArray) -> NDArray[np.bool_]:
        """Which pairs this model answers for."""
        return np.ones(len(p), bool) if self.routes is None else self.routes.shortest_here(p, k)

    @cached_property
    def _sizes(self) -> tuple[FloatArray, FloatArray]:
        """Largest variance and `det^(1/d)` of every entry of the table."""
        shape, d = self.table.shape[:2], self.table.shape[-1]
        largest, smallest = spread(self.table.reshape(-1, d, d))
        return largest.reshape(shape), smallest.reshape(shape)

    @cached_property
    def _extremes(self) -> Extremes:
        return Extremes.of(*self._sizes)

    def bounds(
        self, first_a: IntArray, last_a: IntArray, first_b: IntArray, last_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Largest variance and smallest `det^(1/d)` `(K,)` of C over rectangles of keyframes, ends included."""
        last_row, last_column = self.table.shape[0] - 1, self.table.shape[1] - 1
        largest, smallest = self._extremes.over(
            self.a.node[first_a],
            np.minimum(self.a.node[last_a] + 1, last_row),
            self.b.node[first_b],
            np.minimum(self.b.node[last_b] + 1, last_column),
        )
        inside = (self.a.node[first_a] == self.a.node[last_a]) & (self.b.node[first_b] == self.b.node[last_b])
        ends = (first_a[inside], last_a[inside]), (first_b[inside], last_b[inside])
        largest[inside], smallest[inside] = self._bounds_between_nodes(*ends)
        return largest, smallest

    def _bounds_between_nodes(
        self, ends_a: tuple[IntArray, IntArray], ends_b: tuple[IntArray, IntArray]
    ) -> tuple[FloatArray, FloatArray]:
        """The same for rectangles between two neighbouring nodes of each robot.

        There the largest variance is at most the blend of the four entries' largest variances, which is bilinear: its
        extremes are at the corners of the rectangle.
        """
        corners = [(p, k) for p in ends_a for k in ends_b]
        largest, smallest = (np.stack([self._blended(t, p, k) for p, k in corners]) for t in self._sizes)
        return np.max(largest, axis=0, initial=0.0), np.min(smallest, axis=0, initial=np.inf)

    def _blended(self, table: FloatArray, p: IntArray, k: IntArray) -> FloatArray:
        """Entries of `table` `(nodes of a, nodes of b)` blended for pairs of keyframes."""
        row, column = self.a.node[p], self.b.node[k]
        below, right = np.minimum(row + 1, table.shape[0] - 1), np.minimum(column + 1, table.shape[1] - 1)
        f, g = self.a.fraction[p], self.b.fraction[k]
        above = (1 - g) * table[row, column] + g * table[row, right]
        return np.asarray((1 - f) * above + f * ((1 - g) * table[below, column] + g * table[below, right]))


@dataclass(frozen=True, eq=False)
class ShortestRoutes:
    """Which of several links gives a pair of keyframes the shortest route (paper, section IV-C).

    Args:
        to_link_a, to_link_b: `(links, N)` m of road from each keyframe to each link.
        link: the one that is asked for.
    """

    to_link_a: FloatArray
    to_link_b: FloatArray
    link: int

    def shortest_here(self, p: IntArray, k: IntArray) -> NDArray[np.bool_]:
        """Which pairs `(M,)` have their shortest route over this link; the first of equals."""
        length = self.to_link_a[:, p] + self.to_link_b[:, k]
        return np.asarray(np.argmin(length, axis=0) == self.link)


@dataclass(frozen=True, eq=False)
class Extremes:
    """Maximum of one table and minimum of another over rectangles, from tables of 2^j x 2^j blocks.

    Args:
        largest, smallest: all heights of blocks, flattened one after the other.
        offset, columns: `(J,)` start and width of each height's table.
    """

    largest: FloatArray
    smallest: FloatArray
    offset: IntArray
    columns: IntArray

    @classmethod
    def of(cls, largest: FloatArray, smallest: FloatArray) -> Extremes:
        """From tables `(rows, columns)`."""
        tables = [(largest, smallest)]
        while max(tables[-1][0].shape) > 1:
            tables.append((_pooled(np.maximum, tables[-1][0]), _pooled(np.minimum, tables[-1][1])))
        sizes = [t[0].size for t in tables]
        return cls(
            np.concatenate([t[0].ravel() for t in tables]),
            np.concatenate([t[1].ravel() for t in tables]),
            np.cumsum([0, *sizes[:-1]]),
            np.array([t[0].shape[1] for t in tables]),
        )

    def over(
        self, first_row: IntArray, last_row: IntArray, first_column: IntArray, last_column: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """Extremes `(K,)` over at least the rectangle, ends included: the blocks of its size that touch it."""
        extent = np.maximum(last_row - first_row, last_column - first_column)
        height = np.ceil(np.log2(extent + 1)).astype(np.int64)
        rows = (first_row >> height, last_row >> height)
        columns = (first_column >> height, last_column >> height)
        corners = [self.offset[height] + r * self.columns[height] + c for r in rows for c in columns]
        return (
            np.maximum.reduce([self.largest[corner] for corner in corners]),
            np.minimum.reduce([self.smallest[corner] for corner in corners]),
        )


def _pooled(extreme: np.ufunc, table: FloatArray) -> FloatArray:
    """Extremes of 2 x 2 blocks."""
    by_rows = extreme.reduceat(table, np.arange(0, table.shape[0], 2), axis=0)
    return np.asarray(extreme.reduceat(by_rows, np.arange(0, table.shape[1], 2), axis=1))
