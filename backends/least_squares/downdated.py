"""A normal matrix without a few of its edges: solved by the factors of the whole (Woodbury's identity)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from wiclosure.backends.least_squares.normal_matrix import Factorised
from wiclosure.types import FloatArray, IntArray

Factors: TypeAlias = "Factorised | Downdated"

LEAST_LEFT = 1e-6  # share of an edge's information that others must have, or the difference is lost to rounding


@dataclass(frozen=True, eq=False)
class Downdated:
    """`H - J^T J`, where H is factorised and J `(E D, N K)` are the derivatives of the E edges that are gone.

    Args:
        of: H.
        first, second: `(E,)` nodes of these edges.
        A, B: `(E, D, K)` derivatives by them.
        Y: `(N, K, E D)` solutions `H^-1 J^T`.
        gain: `(E D, E D)`, the inverse of `I - J Y`.
    """

    of: Factors
    first: IntArray
    second: IntArray
    A: FloatArray
    B: FloatArray
    Y: FloatArray
    gain: FloatArray

    @classmethod
    def without(
        cls,
        of: Factors,
        first: IntArray,
        second: IntArray,
        derivatives: tuple[FloatArray, FloatArray],
        size: int,
    ) -> Downdated | None:
        """Of edges between nodes, of `size`; None where little but the edges themselves holds their ends."""
        (A, B), columns = derivatives, np.arange(derivatives[0].shape[0] * derivatives[0].shape[1])
        by_edge, right = columns.reshape(A.shape[:2]), np.zeros((size, A.shape[2], len(columns)))
        for nodes, J in ((first, A), (second, B)):
            right[nodes[:, None], :, by_edge] = J
        found = cls(of, first, second, A, B, of.solve(right), np.eye(len(columns)))
        left = np.eye(len(columns)) - found._seen(found.Y)
        if np.linalg.eigvalsh(0.5 * (left + left.T)).min() < LEAST_LEFT:
            return None
        return cls(of, first, second, A, B, found.Y, np.asarray(np.linalg.inv(left), float))

    def solve(self, right: FloatArray) -> FloatArray:
        """`(N, K, ...)` for `(N, K, ...)`."""
        return self._corrected(self.of.solve(right))

    def less(self, solved: FloatArray, residuals: FloatArray) -> FloatArray:
        """What becomes of solutions `(N, K, S)` of `H x = -J_all^T r` without the edges of residuals `(E, D, S)`."""
        return self._corrected(solved + self.Y @ residuals.reshape(-1, residuals.shape[2]))

    def _corrected(self, solved: FloatArray) -> FloatArray:
        columns = solved.reshape(*solved.shape[:2], -1)
        return np.asarray((columns + self.Y @ (self.gain @ self._seen(columns))).reshape(solved.shape))

    def _seen(self, moved: FloatArray) -> FloatArray:
        """Residuals `(E D, S)` that movements `(N, K, S)` make."""
        return np.asarray((self.A @ moved[self.first] + self.B @ moved[self.second]).reshape(-1, moved.shape[2]))
