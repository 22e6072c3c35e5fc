"""Sparse square root of a pose graph's information matrix, and what is asked of its inverse.

The covariance is `Lambda^-1 = R^-1 R^-T`: with the rows V of R^-1, poses n and m have the covariance `V_n V_m^T`.  A
pose's row has numbers only where its own clique and those above it stand (Davis, Direct Methods for Sparse Linear
Systems, 2006, section 3), of which a graph that lies in a plan has few.  Rows, and columns of the inverse, come of
substitutions for many of them at once: in a clique for those alone that reach it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dtrmm

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.covariance.cliques import Clique, Eliminated


@dataclass(frozen=True, eq=False)
class SquareRoot:
    """Of the information of K poses.

    Args:
        cliques: depth first, so that those above come first and neighbours near each other.
        clique_of: `(K,)` number of each pose's clique.
        slot: `(K,)` number of each pose in its clique.
    """

    cliques: Sequence[Clique]
    clique_of: IntArray
    slot: IntArray

    @classmethod
    def of(cls, eliminated: Eliminated) -> SquareRoot:
        """Of a graph's elimination."""
        cliques = eliminated.cliques()
        size = sum(len(clique.poses) for clique in cliques)
        clique_of, slot = (np.empty(size, np.int64) for _ in range(2))
        for number, clique in enumerate(cliques):
            clique_of[clique.poses], slot[clique.poses] = number, np.arange(len(clique.poses))
        return cls(cliques, clique_of, slot)

    def rows(self, poses: IntArray, parts: FloatArray) -> tuple[FloatArray, IntArray]:
        """Rows of R^-1, as columns: how poses depend on the independent z.

        Args:
            poses: `(P,)`, for speed in an order in which those near each other follow each other.
            parts: `(P, d, 6)` what is asked of each of them.

        Returns:
            Values `(6 C, P, d)`, and the cliques, increasing, whose C poses their rows belong to, in order.
        """
        path = _Path.of(self, poses)
        values = np.zeros((path.size, 6, len(poses), parts.shape[1]))
        values[path.at[poses], :, np.arange(len(poses))] = np.swapaxes(parts, 1, 2)
        spans = path.spans(poses, np.arange(len(poses)))
        path.pull(values.reshape(6 * path.size, -1), spans, parts.shape[1])
        return values.reshape(6 * path.size, len(poses), -1), path.cliques

    def with_ones(self, poses: Sequence[IntArray], ones: IntArray) -> list[FloatArray]:
        """Covariances `(P, 6, 6)` of some poses with one: columns of the inverse, by two sparse substitutions.

        Args:
            poses: for each column those that are asked for; columns of neighbours better follow each other.
            ones: `(G,)` pose of each column.
        """
        asked = np.concatenate([*poses, ones])
        group = np.concatenate([np.repeat(np.arange(len(ones)), [len(own) for own in poses]), np.arange(len(ones))])
        path = _Path.of(self, asked)
        blocks = np.zeros((path.size, 6, len(ones), 6))
        blocks[path.at[ones], :, np.arange(len(ones))] = np.eye(6)
        columns, pulled = blocks.reshape(6 * path.size, -1), path.spans(ones, np.arange(len(ones)))
        path.pull(columns, pulled, 6)
        path.follow(columns, pulled, path.spans(asked, group), 6)
        return [blocks[path.at[own], :, number] for number, own in enumerate(poses)]

    def near(self, n: IntArray, m: IntArray) -> tuple[FloatArray, FloatArray]:
        """Covariance `(K, 6, 6)` of each pose, and `(M, 6, 6)` of poses n with m: NaN where neither follows the other.

        Those that a factor joins follow one another.  With the covariance of all that a clique follows known, its own
        comes of it (Takahashi et al., Formation of a sparse bus impedance matrix, 1973): what it follows is in the
        clique above, or followed by that.
        """
        size = len(self.clique_of)
        own, cross = np.zeros((size, 6, 6)), np.full((len(n), 6, 6), np.nan)
        last = np.maximum(self.clique_of[n], self.clique_of[m])
        order = np.argsort(last, kind="stable")
        bounds = np.searchsorted(last[order], np.arange(len(self.cliques) + 1))
        at = np.full(size, -1)
        fronts: dict[int, tuple[IntArray, FloatArray]] = {}  # on the way down to a clique
        for number, clique in enumerate(self.cliques):
            while fronts and next(reversed(fronts)) != clique.parent:
                fronts.popitem()
            both, front = _front(clique, *fronts.get(clique.parent, (clique.separator, np.zeros((0, 0, 6, 6)))))
            fronts[number] = both, front
            rows = np.arange(len(clique.poses))
            own[clique.poses] = front[rows, rows]
            at[both] = np.arange(len(both))
            pairs = order[bounds[number] : bounds[number + 1]]
            pairs = pairs[(at[n[pairs]] >= 0) & (at[m[pairs]] >= 0)]
            cross[pairs] = front[at[n[pairs]], at[m[pairs]]]
            at[both] = -1
        return own, cross

    def with_ancestors(self, poses: IntArray) -> IntArray:
        """Cliques of poses and all above them, increasing."""
        found: set[int] = set()
        for own in np.unique(self.clique_of[poses]).tolist():
            number = own
            while number >= 0 and number not in found:
                found.add(number)
                number = self.cliques[number].parent
        return np.array(sorted(found), np.int64)

    def lengths(self, cliques: IntArray) -> IntArray:
        """How many poses cliques have."""
        return np.array([len(self.cliques[number].poses) for number in cliques.tolist()], np.int64)


@dataclass(frozen=True, eq=False)
class _Path:
    """Some poses, and all in the cliques above them.

    Args:
        root: the whole.
        cliques: increasing.
        at: `(K,)` where each of the poses stands among them; others anywhere.
    """

    root: SquareRoot
    cliques: IntArray
    at: IntArray

    @classmethod
    def of(cls, root: SquareRoot, poses: IntArray) -> _Path:
        cliques = root.with_ancestors(poses)
        members = np.concatenate([root.cliques[number].poses for number in cliques.tolist()])
        at = np.empty(len(root.clique_of), np.int64)
        at[members] = np.arange(len(members))
        return cls(root, cliques, at)

    @cached_property
    def ends(self) -> list[int]:
        """Where each clique ends."""
        ends: list[int] = np.cumsum(self.root.lengths(self.cliques)).tolist()
        return ends

    @property
    def size(self) -> int:
        """How many poses there are."""
        return self.ends[-1]

    def spans(self, poses: IntArray, columns: IntArray) -> list[tuple[int, int]]:
        """For each clique the columns, from the first to that after the last, of poses in it and below it."""
        number = {clique: n for n, clique in enumerate(self.cliques.tolist())}
        own = np.searchsorted(self.cliques, self.root.clique_of[poses])
        first, last = np.full(len(number), len(columns)), np.full(len(number), -1)
        np.minimum.at(first, own, columns)
        np.maximum.at(last, own, columns)
        spans = list(zip(first.tolist(), (last + 1).tolist(), strict=True))
        for n in reversed(range(len(spans))):
            if (parent := self.root.cliques[int(self.cliques[n])].parent) >= 0:
                above, below = spans[number[parent]], spans[n]
                spans[number[parent]] = min(above[0], below[0]), max(above[1], below[1])
        return spans

    def pull(self, values: FloatArray, spans: Sequence[tuple[int, int]], width: int) -> None:
        """In place, from `A` to `R^-T A`: what a pose follows is pulled with it.

        Args:
            values: `(6 C, ...)`, of which each column is `width` wide.
            spans: columns of each clique that are not zero.
            width: of a column.
        """
        for clique, own, columns in reversed(list(self._steps(spans, width))):
            moved = values[own, columns]
            values[self._rows(clique.separator), columns] += clique.response.T @ moved
            moved[:] = dtrmm(1.0, clique.remainder, moved.T, side=1).T  # of a triangle, at half the cost of `@`

    def follow(
        self,
        values: FloatArray,
        pulled: Sequence[tuple[int, int]],
        spans: Sequence[tuple[int, int]],
        width: int,
    ) -> None:
        """In place, from `A` to `R^-1 A` in some columns of each clique; where they were not `pulled` they are zero."""
        moving = [first < after for first, after in pulled]
        for n, (clique, own, columns) in enumerate(self._steps(spans, width)):
            following = clique.response @ values[self._rows(clique.separator), columns]
            if moving[n]:
                following += clique.remainder @ values[own, columns]
            values[own, columns] = following

    def _steps(self, spans: Sequence[tuple[int, int]], width: int) -> Iterator[tuple[Clique, slice, slice]]:
        """Each clique from the root, its rows, and its columns."""
        start = 0
        for number, end, (first, after) in zip(self.cliques.tolist(), self.ends, spans, strict=True):
            yield self.root.cliques[number], slice(6 * start, 6 * end), slice(width * first, width * max(first, after))
            start = end

    def _rows(self, poses: IntArray) -> IntArray:
        return (6 * self.at[poses][:, None] + np.arange(6)).ravel()


def _front(clique: Clique, above: IntArray, covariance: FloatArray) -> tuple[IntArray, FloatArray]:
    """Poses of a clique and its separator, and their covariance `(n, n, 6, 6)`, from that of the clique above."""
    k, w = len(clique.poses), len(clique.separator)
    order = np.argsort(above)
    wanted = order[np.searchsorted(above, clique.separator, sorter=order)]
    front = np.empty((k + w, 6, k + w, 6))
    known = covariance[wanted[:, None], wanted].swapaxes(1, 2)
    cross = clique.response @ known.reshape(6 * w, 6 * w)
    front[k:, :, k:] = known
    front[:k, :, k:] = cross.reshape(k, 6, w, 6)
    front[k:, :, :k] = cross.T.reshape(w, 6, k, 6)
    front[:k, :, :k] = (cross @ clique.response.T + clique.remainder @ clique.remainder.T).reshape(k, 6, k, 6)
    return np.concatenate([clique.poses, clique.separator]), front.swapaxes(1, 2)
