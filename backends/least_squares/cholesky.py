"""Sparse Cholesky factors front by front: all arithmetic is that of small dense matrices, by LAPACK and BLAS.

Duff and Reid (TOMS 1983); Liu, "The multifrontal method for sparse matrix solution" (SIAM Review 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg.blas import dsyrk, dtrsm
from scipy.linalg.lapack import dpotrf

from wiclosure.backends.least_squares.fronts import Front
from wiclosure.types import FloatArray, IntArray

STRIP = 64  # columns that are added at once: half of a symmetric matrix is saved


@dataclass(frozen=True, eq=False)
class Pattern:
    """Which blocks of an ordered symmetric matrix are not zero, and how its fronts hold them.

    Each front has a matrix of its nodes and one of its rest by its nodes, in one array, column by column.

    Args:
        fronts: of N nodes, children before parents.
        order: `(B,)` of the blocks given, by their place.
        starts: in that order, where the blocks of one place begin.
        bounds: `(F + 1,)` of each front's places.
        places: `(P, 4)` of each place: blocks before its matrix, that one's rows of blocks, and row and column there.
        in_parent: by front, where the nodes of its rest are in its parent, among the nodes and then those of the rest.
    """

    fronts: Sequence[Front]
    order: IntArray
    starts: IntArray
    bounds: IntArray
    places: IntArray
    in_parent: Sequence[IntArray]

    @classmethod
    def of(cls, fronts: Sequence[Front], rows: IntArray, columns: IntArray, size: int) -> Pattern:
        """For blocks at `rows <= columns` `(B,)`, those at one place summed; each node has one on the diagonal."""
        order = np.argsort(rows * size + columns, kind="stable")
        number = (rows * size + columns)[order]
        starts = np.flatnonzero(np.diff(number, prepend=-1))
        i, j = number[starts] // size, number[starts] % size
        bounds = np.searchsorted(i, [*(front.start for front in fronts), size])
        places = np.empty((len(starts), 4), np.int64)
        for front, begin, end in zip(fronts, bounds[:-1], bounds[1:], strict=True):
            nodes, row = front.stop - front.start, _local(front, j[begin:end])
            below = row >= nodes
            places[begin:end, 0] = np.where(below, nodes**2, 0)
            places[begin:end, 1] = np.where(below, len(front.rest), nodes)
            places[begin:end, 2] = np.where(below, row - nodes, row)
            places[begin:end, 3] = i[begin:end] - front.start
        in_parent = [_local(fronts[front.parent], front.rest) for front in fronts]
        return cls(fronts, order, starts, bounds, places, in_parent)

    def factorised(self, blocks: FloatArray) -> Cholesky | None:
        """Of the blocks `(B, K, K)`; None if the matrix is not positive definite."""
        width, at = blocks.shape[-1], self._entries(blocks.shape[-1])
        summed = np.add.reduceat(blocks[self.order], self.starts, axis=0)
        left: dict[int, list[tuple[IntArray, FloatArray]]] = {}  # by parent, what its children leave
        diagonal, below = [], []
        for n, front in enumerate(self.fronts):
            nodes, rest = width * (front.stop - front.start), width * len(front.rest)
            own, U = np.zeros((nodes + rest) * nodes), np.zeros((rest, rest), order="F")
            own[at[self.bounds[n] : self.bounds[n + 1]]] = summed[self.bounds[n] : self.bounds[n + 1]]
            D, E = (part.reshape(-1, nodes, order="F") for part in (own[: nodes**2], own[nodes**2 :]))
            for local, of_child in left.pop(n, ()):
                _add(D, E, U, of_child, local)
            L, failed = dpotrf(D, lower=1, overwrite_a=1)
            if failed:
                return None
            if rest:
                E = dtrsm(1.0, L, E, side=1, lower=1, trans_a=1, overwrite_b=1)
                U = dsyrk(-1.0, E, beta=1.0, c=U, lower=1, overwrite_c=1)
                left.setdefault(front.parent, []).append((_elements(self.in_parent[n], width), U))
            diagonal.append(L)
            below.append(E)
        return Cholesky(self.fronts, diagonal, below, width)

    def _entries(self, width: int) -> IntArray:
        """`(P, K, K)` where the entries of each place's block, transposed, are in its front's array."""
        before, height, row, column = self.places.T[..., None, None]
        i, j = np.arange(width)[:, None], np.arange(width)
        return np.asarray(width**2 * before + (width * row + j) + width * height * (width * column + i))


@dataclass(frozen=True, eq=False)
class Cholesky:
    """Factors, by front.

    Args:
        fronts: children before parents.
        diagonal: lower triangles of the front's nodes.
        below: `(R K, C K)` rows of its rest.
        width: K unknowns a node.
    """

    fronts: Sequence[Front]
    diagonal: Sequence[FloatArray]
    below: Sequence[FloatArray]
    width: int

    def solve(self, right: FloatArray) -> FloatArray:
        """`(N K, S)` for `(N K, S)`."""
        x = right.copy()
        self.forward(x, range(len(self.fronts)))
        for n in reversed(range(len(self.fronts))):
            part, rest = self._part(n), self._rests[n]
            if len(rest):
                x[part] -= self.below[n].T @ x[rest]
            x[part] = dtrsm(1.0, self.diagonal[n], x[part].T, side=1, lower=1).T
        return x

    def forward(self, x: FloatArray, fronts: Sequence[int]) -> None:
        """The first half of it, `L^-1 x`, in place of `x (N K, S)`: by the fronts that `x` reaches, in their order."""
        for n in fronts:
            part, rest = self._part(n), self._rests[n]
            x[part] = dtrsm(1.0, self.diagonal[n], x[part].T, side=1, lower=1, trans_a=1).T
            if len(rest):
                x[rest] -= self.below[n] @ x[part]

    def reached(self, nodes: IntArray) -> IntArray:
        """Fronts of the nodes, and all above these: elsewhere `L^-1 x` is zero where `x` is zero but at the nodes."""
        left = set((np.searchsorted([front.start for front in self.fronts], nodes, side="right") - 1).tolist())
        reached: set[int] = set()
        while left:
            reached |= left
            left = {self.fronts[n].parent for n in left if len(self.fronts[n].rest)} - reached
        return np.array(sorted(reached), np.int64)

    def elements(self, fronts: IntArray) -> IntArray:
        """Rows of all unknowns of some fronts."""
        return np.concatenate([np.arange(self._part(n).start, self._part(n).stop) for n in fronts.tolist()])

    @cached_property
    def _rests(self) -> list[IntArray]:
        return [_elements(front.rest, self.width) for front in self.fronts]

    def _part(self, n: int) -> slice:
        return slice(self.width * self.fronts[n].start, self.width * self.fronts[n].stop)


def _local(front: Front, nodes: IntArray) -> IntArray:
    """Of nodes, which the front holds: their places among its nodes and then those of its rest."""
    later = front.stop - front.start + np.searchsorted(front.rest, nodes)
    return np.where(nodes < front.stop, nodes - front.start, later)


def _add(D: FloatArray, E: FloatArray, U: FloatArray, of_child: FloatArray, at: IntArray) -> None:
    """What a child leaves `(R, R)`, at the unknowns `at (R,)` of this front: its lower triangle, strip by strip."""
    nodes = len(D)
    split = int(np.searchsorted(at, nodes))
    inside, outside = at[:split], at[split:] - nodes
    _add_triangle(D, of_child[:split, :split], inside)
    if len(outside):
        _add_entries(E, of_child[split:, :split], outside, inside)
        _add_triangle(U, of_child[split:, split:], outside)


def _add_triangle(of: FloatArray, part: FloatArray, at: IntArray) -> None:
    for start in range(0, len(at), STRIP):
        strip = slice(start, start + STRIP)
        _add_entries(of, part[start:, strip], at[start:], at[strip])


def _add_entries(of: FloatArray, part: FloatArray, rows: IntArray, columns: IntArray) -> None:
    """A matrix at rows and columns of another whose columns follow each other in memory."""
    np.add.at(of.reshape(-1, order="F"), (rows + len(of) * columns[:, None]).ravel(), part.T.ravel())


def _elements(nodes: IntArray, width: int) -> IntArray:
    return np.asarray((width * nodes[:, None] + np.arange(width)).ravel())
