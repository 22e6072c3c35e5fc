"""Normal matrices of least squares over nodes of a few degrees of freedom: sparse, ordered once, factorised often."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from wiclosure.backends.least_squares.cholesky import Cholesky, Pattern
from wiclosure.backends.least_squares.fronts import fronts_of
from wiclosure.types import FloatArray, IntArray

HELD = 1e12  # information of a pose that is held
LEAST_INFORMATION = 1e-9  # of any other: the matrix stays regular where nothing fixes the gauge
LEAST_DAMPING = 1e-14  # where rounding leaves a matrix that is not positive


@dataclass(frozen=True, eq=False)
class Factorised:
    """A normal matrix, factorised: solves for any right-hand side."""

    of: Cholesky
    position: IntArray

    def solve(self, right: FloatArray) -> FloatArray:
        """`(N, K, ...)` for `(N, K, ...)`."""
        ordered = np.empty_like(right)
        ordered[self.position] = right
        solved = self.of.solve(ordered.reshape(right.shape[0] * right.shape[1], -1)).reshape(right.shape)
        return np.asarray(solved[self.position])


@dataclass(frozen=True, eq=False)
class NormalMatrix:
    """The pattern of the normal matrix of edges `(M,)` between N nodes.

    Args:
        first, second: `(M,)` nodes.
        position: `(N,)` place of each node in the order of elimination.
        pattern: of the ordered matrix.
    """

    first: IntArray
    second: IntArray
    position: IntArray
    pattern: Pattern

    @classmethod
    def of(cls, first: IntArray, second: IntArray, size: int) -> NormalMatrix:
        """Of edges between the nodes `first` and `second` of `size`."""
        position, fronts = fronts_of(first, second, size)
        i, j, nodes = position[first], position[second], np.arange(size)
        rows, columns = np.concatenate([i, j, np.minimum(i, j), nodes]), np.concatenate([i, j, np.maximum(i, j), nodes])
        return cls(first, second, position, Pattern.of(fronts, rows, columns, size))

    def factorised(
        self, A: FloatArray, B: FloatArray, weights: FloatArray, held: IntArray, damping: float
    ) -> Factorised:
        """Of whitened derivatives `(M, K, K)` by both ends of the edges, weighted `(M,)`.

        Args:
            A: derivatives by the first end.
            B: by the second.
            weights: of the edges.
            held: nodes that do not move.
            damping: share of the diagonal that is added to it.
        """
        At, Bt = (np.swapaxes(weights[:, None, None] * J, 1, 2) for J in (A, B))
        by_first, by_second, between = At @ A, Bt @ B, At @ B
        turned = self.position[self.first] > self.position[self.second]
        between[turned] = np.swapaxes(between[turned], 1, 2)
        size, width = len(self.position), A.shape[-1]
        diagonal = self.gathered(*(np.diagonal(blocks, axis1=1, axis2=2) for blocks in (by_first, by_second)))
        least = np.full((size, width), LEAST_INFORMATION)
        least[held] = HELD
        while True:
            added = np.zeros((size, width, width))
            added[self.position[:, None], np.arange(width), np.arange(width)] = least + damping * diagonal
            of = self.pattern.factorised(np.concatenate([by_first, by_second, between, added]))
            if of is not None:
                return Factorised(of, self.position)
            damping = max(10.0 * damping, LEAST_DAMPING)

    def gathered(self, at_first: FloatArray, at_second: FloatArray) -> FloatArray:
        """Sums `(N, K, ...)` at the nodes of what the edges `(M, K, ...)` have at either end."""
        count, *shape = at_first.shape
        width = int(np.prod(shape))
        summed = sum(of @ at.reshape(count, width) for of, at in zip(self._ends, (at_first, at_second), strict=True))
        return np.asarray(summed).reshape(-1, *shape)

    @cached_property
    def _ends(self) -> tuple[sp.csr_matrix, sp.csr_matrix]:
        """`(N, M)` matrices, one at each edge's first and at its second node."""
        count, size = len(self.first), len(self.position)
        ones, edges = np.ones(count), np.arange(count)
        at_first, at_second = (
            sp.csr_matrix((ones, (of, edges)), shape=(size, count)) for of in (self.first, self.second)
        )
        return at_first, at_second
