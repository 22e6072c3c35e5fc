"""A least-squares system at some poses: what a step of Levenberg-Marquardt takes, and where it leads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.normal_matrix import Factorised
from wiclosure.types import FloatArray

if TYPE_CHECKING:
    from wiclosure.backends.least_squares.system import System

FAST = 0.1  # share of the decrease by one step, up to which that of the next tells that the same factors still serve


@dataclass(frozen=True, eq=False)
class Linearised:
    """A system at some poses; each of its parts is computed when first asked for.

    Args:
        system: M edges over N nodes.
        poses: `(N, 4, 4)`.
        w: `(M,)` weights of the edges.
    """

    system: System
    poses: FloatArray
    w: FloatArray

    @cached_property
    def predicted(self) -> FloatArray:
        """Of the edges `(M, 4, 4)`."""
        return self.system.edges.predicted(self.poses)

    @cached_property
    def errors(self) -> FloatArray:
        """Tangent vectors `(M, 6)`."""
        return self.system.edges.errors_of(self.predicted)

    @cached_property
    def residuals(self) -> FloatArray:
        """`(M, D)`, whitened."""
        return self.system.whitened(self.errors)

    @cached_property
    def cost(self) -> float:
        """Weighted sum of squared residuals."""
        return float(self.w @ np.sum(self.residuals**2, axis=1))

    @cached_property
    def jacobians(self) -> tuple[FloatArray, FloatArray]:
        """`(M, D, K)` by both ends."""
        return self.system.derivatives(self.predicted, self.errors)

    @cached_property
    def gradient(self) -> FloatArray:
        """`(N, K)` of the weighted cost."""
        return self.system.gradient(self.jacobians, self.w[:, None] * self.residuals)

    def moved(self, step: FloatArray) -> Linearised:
        """After a step `(N, K)`."""
        return Linearised(self.system, self.poses @ se3.exp(self.system.tangents(step)), self.w)

    def predicted_cost(self, step: FloatArray) -> float:
        """That which the derivatives predict after a step `(N, K)`."""
        (A, B), edges = self.jacobians, self.system.edges
        moved = A @ step[edges.first, :, None] + B @ step[edges.second, :, None]
        return float(self.w @ np.sum((self.residuals + moved[..., 0]) ** 2, axis=1))

    def further(self, decrease: float, factorised: Factorised, converged: float) -> tuple[Linearised, float]:
        """More steps with the same factors, as long as each lowers the cost by a small part of what the last one did.

        Derivatives by the bodies at both ends of an edge change with their relative pose alone, so little once it is
        about as measured.

        Args:
            decrease: of the cost, by the step that led here.
            factorised: the factors.
            converged: relative decrease below which no step follows.

        Returns:
            Where they end, and the decrease by the last.
        """
        at = self
        while decrease > converged * (at.cost + 1e-9):
            moved = at.moved(factorised.solve(-at.gradient))
            if not moved.cost <= at.cost:
                return at, decrease
            before, decrease, at = decrease, at.cost - moved.cost, moved
            if decrease > FAST * before:
                break
        return at, decrease
