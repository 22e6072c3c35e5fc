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

STRIP = 32  # rows of blocks that are added at once: half of a symmetric matrix is saved


@dataclass(frozen=True, eq=False)
class Pattern:
    """Which blocks of an ordered symmetric matrix are not zero, and how its fronts hold them.

    Args:
        fronts: of N nodes, children before parents.
        order: `(B,)` of the blocks given, by their place.
        starts: in that order, where the blocks of one place begin.
        bounds: `(F + 1,)` of each front's places.
        local: `(P, 2)` row and column of each place, among the front's nodes and then those of its rest.
        in_parent: by front, where the nodes of its rest are in its parent.
    """

    fronts: Sequence[Front]
    order: IntArray
    starts: IntArray
    bounds: IntArray
    local: IntArray
    in_parent: Sequence[IntArray]

    @classmethod
    def of(cls, fronts: Sequence[Front], rows: IntArray, columns: IntArray, size: int) -> Pattern:
        """For blocks at `rows <= columns` `(B,)`, those at one place summed; each node has one on the diagonal."""
        order = np.argsort(rows * size + columns, kind="stable")
        places = (rows * size + columns)[order]
        starts = np.flatnonzero(np.diff(places, prepend=-1))
        i, j = places[starts] // size, places[starts] % size
        bounds = np.searchsorted(i, [*(front.start for front in fronts), size])
        local = np.empty((len(starts), 2), np.int64)
        for front, begin, end in zip(fronts, bounds[:-1], bounds[1:], strict=True):
            local[begin:end, 0] = i[begin:end] - front.start
            local[begin:end, 1] = _local(front, j[begin:end])
        in_parent = [_local(fronts[front.parent], front.rest) for front in fronts]
        return cls(fronts, order, starts, bounds, local, in_parent)

    def factorised(self, blocks: FloatArray) -> Cholesky | None:
        """Of the blocks `(B, K, K)`; None if the matrix is not positive definite."""
        width = blocks.shape[-1]
        summed = np.add.reduceat(blocks[self.order], self.starts, axis=0)
        left: dict[int, list[tuple[IntArray, FloatArray]]] = {}  # by parent, what its children leave
        diagonal, below = [], []
        for n, front in enumerate(self.fronts):
            D, E, U = _zeros(front, width)
            rows = slice(self.bounds[n], self.bounds[n + 1])
            _enter(D, E, summed[rows], self.local[rows], front.stop - front.start)
            for local, of_child in left.pop(n, ()):
                _add(D, E, U, of_child, local, width)
            L, failed = dpotrf(D, lower=1, overwrite_a=1)
            if failed:
                return None
            if len(front.rest):
                E = dtrsm(1.0, L, E, side=1, lower=1, trans_a=1, overwrite_b=1)
                U = dsyrk(-1.0, E, beta=1.0, c=U, lower=1, overwrite_c=1)
                left.setdefault(front.parent, []).append((self.in_parent[n], U))
            diagonal.append(L)
            below.append(E)
        return Cholesky(self.fronts, diagonal, below, width)


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


def _zeros(front: Front, width: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The front's matrix: of its nodes, of its rest by its nodes, of its rest."""
    nodes, rest = width * (front.stop - front.start), width * len(front.rest)
    shapes = (nodes, nodes), (rest, nodes), (rest, rest)
    D, E, U = (np.zeros(shape, order="F") for shape in shapes)
    return D, E, U


def _by_block(of: FloatArray, width: int) -> FloatArray:
    """A view `(C, K, R, K)` of a matrix whose columns follow each other in memory."""
    return of.T.reshape(of.shape[1] // width, width, of.shape[0] // width, width)


def _enter(D: FloatArray, E: FloatArray, blocks: FloatArray, local: IntArray, nodes: int) -> None:
    """Blocks `(P, K, K)` at rows and columns `(P, 2)`, into the lower triangle: each transposed."""
    inside = local[:, 1] < nodes
    for of, part, shift in ((D, inside, 0), (E, ~inside, nodes)):
        _by_block(of, blocks.shape[-1])[local[part, 0], :, local[part, 1] - shift, :] = blocks[part]


def _add(D: FloatArray, E: FloatArray, U: FloatArray, of_child: FloatArray, local: IntArray, width: int) -> None:
    """What a child leaves `(R K, R K)`, at the places of its rest in this front."""
    nodes, left = D.shape[0] // width, _by_block(of_child, width)
    split = int(np.searchsorted(local, nodes))
    inside, outside = local[:split], local[split:] - nodes
    _add_triangle(_by_block(D, width), left[:split, :, :split], inside)
    if len(outside):
        _by_block(E, width)[inside[:, None], :, outside, :] += left[:split, :, split:].swapaxes(1, 2)
        _add_triangle(_by_block(U, width), left[split:, :, split:], outside)


def _add_triangle(of: FloatArray, blocks: FloatArray, at: IntArray) -> None:
    """Blocks `(R, K, R, K)` at the rows and columns `(R,)`: those on the diagonal and after it, strip by strip."""
    for start in range(0, len(at), STRIP):
        rows, part = at[start : start + STRIP], blocks[start : start + STRIP, :, start:]
        of[rows[:, None], :, at[start:], :] += part.swapaxes(1, 2)


def _elements(nodes: IntArray, width: int) -> IntArray:
    return np.asarray((width * nodes[:, None] + np.arange(width)).ravel())
