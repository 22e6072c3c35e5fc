"""Normal matrices of least squares over nodes of a few degrees of freedom: sparse, ordered once, factorised often."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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

    def half_solved(self, nodes: IntArray, right: FloatArray) -> tuple[IntArray, FloatArray]:
        """`L^-1 b`, L being the factor, for a `b` that is `right (M, K, S)` at these nodes `(M,)` and zero elsewhere.

        Returns:
            The rows that are not zero `(R,)`, in the order of elimination, and what they are `(R, S)`.
        """
        (_, width, columns), place = right.shape, self.position[nodes]
        x = np.zeros((len(self.position), width, columns))
        x[place] = right
        fronts, of_unknowns = self.of.reached(place), x.reshape(-1, columns)
        self.of.forward(of_unknowns, fronts.tolist())
        rows = self.of.elements(fronts)
        return rows, of_unknowns[rows]


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
        diagonal = np.zeros((size, width))
        for nodes, of_edges in ((self.first, by_first), (self.second, by_second)):
            np.add.at(diagonal, nodes, np.diagonal(of_edges, axis1=1, axis2=2))
        least = np.full((size, width), LEAST_INFORMATION)
        least[held] = HELD
        while True:
            added = np.zeros((size, width, width))
            added[self.position[:, None], np.arange(width), np.arange(width)] = least + damping * diagonal
            of = self.pattern.factorised(np.concatenate([by_first, by_second, between, added]))
            if of is not None:
                return Factorised(of, self.position)
            damping = max(10.0 * damping, LEAST_DAMPING)
