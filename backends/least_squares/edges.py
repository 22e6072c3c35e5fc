"""Relative pose measurements as arrays, their least squares, and what their noise does to the estimate.

Everything here is vectorised over the edges; the sparse normal equations are solved by `normal_matrix`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.levenberg_marquardt import descended
from wiclosure.backends.least_squares.normal_matrix import DEGREES, Factorised, NormalMatrix
from wiclosure.types import BoolArray, FloatArray, IntArray

STEPS = 30  # of Gauss-Newton; damped
CONVERGED = 1e-5  # relative decrease of the cost below which it has converged
LEAST_DAMPED = 1e-6
MOST_DAMPED = 1e8
IN_PLANE = 1e-6  # rad, m: by rounding
LEAST_VARIANCE = 1e-12  # rad^2, m^2: covariances that are stated as singular can be inverted


@dataclass(frozen=True, eq=False)
class Edges:
    """Measured poses of node `second` in node `first`.

    Args:
        first, second: `(M,)` indices of nodes.
        T: `(M, 4, 4)`, the second node's body in the first's.
        covariance: `(M, 6, 6)` of `T`, as errors in the second's body.
    """

    first: IntArray
    second: IntArray
    T: FloatArray
    covariance: FloatArray

    def __len__(self) -> int:
        return len(self.first)

    def __add__(self, more: Edges) -> Edges:
        return Edges.stacked([self, more])

    @classmethod
    def stacked(cls, parts: Sequence[Edges]) -> Edges:
        """One after another."""
        none = np.zeros(0, np.int64)
        return cls(
            np.concatenate([none, *(e.first for e in parts)]),
            np.concatenate([none, *(e.second for e in parts)]),
            np.concatenate([np.zeros((0, 4, 4)), *(e.T for e in parts)]),
            np.concatenate([np.zeros((0, 6, 6)), *(e.covariance for e in parts)]),
        )

    def subset(self, rows: IntArray | BoolArray) -> Edges:
        """The edges at `rows`, boolean or indices."""
        return Edges(self.first[rows], self.second[rows], self.T[rows], self.covariance[rows])

    def errors(self, poses: FloatArray) -> FloatArray:
        """Tangent vectors `(M, 6)` from each measurement to the poses `(N, 4, 4)`."""
        return se3.log(se3.between(self.T, se3.between(poses[self.first], poses[self.second])))


def degrees_of_freedom(*transforms: FloatArray) -> int:
    """3 where all transforms `(..., 4, 4)` stay in the plane, else 6: residuals of planar graphs have no others."""
    planar = (
        np.abs(T[..., 2, :2]).max(initial=0.0) < IN_PLANE and np.abs(T[..., 2, 3]).max(initial=0.0) < IN_PLANE
        for T in transforms
    )
    return 3 if all(planar) else DEGREES


def mahalanobis_squared(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """`e^T Sigma^-1 e` for stacks `(M, 6)` and `(M, 6, 6)`."""
    return np.asarray(np.einsum("mi,mi->m", error, np.linalg.solve(covariance, error[..., None])[..., 0]))


def whiteners(covariance: FloatArray) -> FloatArray:
    """`(M, 6, 6)` matrices W with `W Sigma W^T = I`."""
    L = np.linalg.cholesky(covariance + LEAST_VARIANCE * np.eye(6))
    return np.asarray(np.linalg.inv(L))


@dataclass(frozen=True, eq=False)
class System:
    """Edges over `size` nodes, linearised where the poses are; the nodes `held` do not move."""

    edges: Edges
    size: int
    held: IntArray
    W: FloatArray

    @classmethod
    def of(cls, edges: Edges, size: int, held: IntArray) -> System:
        """Covariances are inverted once."""
        return cls(edges, size, np.asarray(held), whiteners(edges.covariance))

    def subset(self, rows: BoolArray) -> System:
        """Of the edges at `rows`."""
        return self if rows.all() else System(self.edges.subset(rows), self.size, self.held, self.W[rows])

    @cached_property
    def normal(self) -> NormalMatrix:
        """Where the normal matrix is not zero, and in what order it is eliminated."""
        return NormalMatrix.of(self.edges.first, self.edges.second, self.size)

    def residuals(self, poses: FloatArray) -> FloatArray:
        """Whitened errors `(M, 6)`."""
        return np.asarray((self.W @ self.edges.errors(poses)[..., None])[..., 0])

    def chi_squares(self, poses: FloatArray) -> FloatArray:
        """Squared Mahalanobis distances `(M,)`."""
        return np.asarray(np.sum(self.residuals(poses) ** 2, axis=1))

    def jacobians(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened derivatives `(M, 6, 6)` by perturbations of both ends in their bodies."""
        T_first_second = se3.between(poses[self.edges.first], poses[self.edges.second])
        error = se3.log(se3.between(self.edges.T, T_first_second))
        by_second = self.W @ _inverse_right_jacobian(error)
        return -by_second @ se3.adjoint(se3.inverse(T_first_second)), by_second

    def gradient(self, jacobians: tuple[FloatArray, FloatArray], residuals: FloatArray) -> FloatArray:
        """`J^T r` `(N, 6, ...)` for weighted residuals `(M, 6, ...)`."""
        columns = residuals if residuals.ndim == 3 else residuals[..., None]
        at_first, at_second = (np.swapaxes(J, 1, 2) @ columns for J in jacobians)
        return self.normal.gathered(at_first, at_second).reshape(self.size, *residuals.shape[1:])

    def solved(self, poses: FloatArray, weights: FloatArray | None = None, steps: int = STEPS) -> FloatArray:
        """Levenberg-Marquardt from the poses `(N, 4, 4)`.

        Edges of no weight are left out: false ones would join everything with everything, and fill the matrix.
        """
        w = np.ones(len(self.edges)) if weights is None else weights
        system, w = self.subset(w > 0), w[w > 0]
        return system._descended(poses, w, steps)[0] if steps < STEPS or (w < 1).any() else system._unweighted(poses)

    def sampled(self, poses: FloatArray, weights: FloatArray, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same estimate, and what noise of the edges does to it: `(N, 6, S)` for whitened `(M, 6, S)`.

        To first order, about where the last step of the estimate began: it hardly moved.
        """
        used = weights > 0
        system, w = self.subset(used), weights[used]
        poses, last = system._descended(self.solved(poses, weights), w, STEPS)
        if last is None:
            J = system.jacobians(poses)
            last = J, system.normal.factorised(*J, w, self.held, 0.0)
        J, factorised = last
        return poses, factorised.solve(-system.gradient(J, w[:, None, None] * noise[used]))

    def _unweighted(self, poses: FloatArray) -> FloatArray:
        edges = self.edges
        return descended(edges.first, edges.second, edges.T, self.W, poses, self.held)

    def _descended(
        self, poses: FloatArray, w: FloatArray, steps: int
    ) -> tuple[FloatArray, tuple[tuple[FloatArray, FloatArray], Factorised] | None]:
        """Poses, and if the last step hardly moved them, its derivatives and undamped normal equations."""
        damping, cost = 0.0, self._cost(poses, w)
        for _ in range(steps):
            J = self.jacobians(poses)
            gradient = self.gradient(J, w[:, None] * self.residuals(poses))
            while damping < MOST_DAMPED:
                factorised = self.normal.factorised(*J, w, self.held, damping)
                moved = poses @ se3.exp(factorised.solve(-gradient))
                new_cost = self._cost(moved, w)
                if new_cost <= cost:
                    break
                damping = max(10.0 * damping, LEAST_DAMPED)
            else:
                return poses, None
            undamped, damping = damping == 0.0, damping / 10.0 if damping > LEAST_DAMPED else 0.0
            decrease, poses, cost = cost - new_cost, moved, new_cost
            if decrease <= CONVERGED * (cost + 1e-9):
                return poses, (J, factorised) if undamped else None
        return poses, None

    def _cost(self, poses: FloatArray, weights: FloatArray) -> float:
        return float(weights @ self.chi_squares(poses))


def _inverse_right_jacobian(xi: FloatArray) -> FloatArray:
    """Of the logarithm on SE(3), to second order: `I + ad / 2 + ad^2 / 12`."""
    ad = np.zeros((len(xi), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = se3.skew(xi[:, :3])
    ad[:, 3:, :3] = se3.skew(xi[:, 3:])
    return np.asarray(np.eye(6) + 0.5 * ad + (ad @ ad) / 12.0)
