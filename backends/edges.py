"""Relative pose measurements as arrays, their least squares, and what their noise does to the estimate.

Everything here is vectorised over the edges; the sparse normal equations are factorised by SuperLU.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray, IntArray

STEPS = 30  # of Gauss-Newton; damped
CONVERGED = 1e-5  # relative decrease of the cost below which it has converged
MOST_DAMPED = 1e8
HELD = 1e12  # information of a pose that is held
DEGREES = 6  # of freedom of a pose
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

    def residuals(self, poses: FloatArray) -> FloatArray:
        """Whitened errors `(M, 6)`."""
        return np.asarray(np.einsum("mij,mj->mi", self.W, self.edges.errors(poses)))

    def chi_squares(self, poses: FloatArray) -> FloatArray:
        """Squared Mahalanobis distances `(M,)`."""
        return np.asarray(np.sum(self.residuals(poses) ** 2, axis=1))

    def jacobians(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened derivatives `(M, 6, 6)` by perturbations of both ends in their bodies."""
        T_first_second = se3.between(poses[self.edges.first], poses[self.edges.second])
        error = se3.log(se3.between(self.edges.T, T_first_second))
        by_second = self.W @ _inverse_right_jacobian(error)
        return -by_second @ se3.adjoint(se3.inverse(T_first_second)), by_second

    def factorised(self, jacobians: tuple[FloatArray, FloatArray], weights: FloatArray, damping: float) -> SuperLU:
        """The normal matrix with edges weighted `(M,)`."""
        A, B = jacobians
        wA, wB = weights[:, None, None] * A, weights[:, None, None] * B
        At, Bt = np.swapaxes(A, 1, 2), np.swapaxes(B, 1, 2)
        i, j = self.edges.first, self.edges.second
        rows, columns = np.concatenate([i, i, j, j]), np.concatenate([i, j, i, j])
        H = _block_matrix(rows, columns, np.concatenate([At @ wA, At @ wB, Bt @ wA, Bt @ wB]), self.size)
        diagonal = np.full(6 * self.size, 1e-9)
        diagonal[(6 * self.held[:, None] + np.arange(6)).ravel()] = HELD
        H = H + sp.diags(diagonal + damping * H.diagonal())
        return splu(H.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})

    def gradient(self, jacobians: tuple[FloatArray, FloatArray], residuals: FloatArray) -> FloatArray:
        """`J^T r` `(6 N, ...)` for weighted residuals `(M, 6, ...)`."""
        A, B = jacobians
        found = np.zeros((self.size, *residuals.shape[1:]))
        np.add.at(found, self.edges.first, np.einsum("mji,mj...->mi...", A, residuals))
        np.add.at(found, self.edges.second, np.einsum("mji,mj...->mi...", B, residuals))
        return found.reshape(6 * self.size, *residuals.shape[2:])

    def solved(self, poses: FloatArray, weights: FloatArray | None = None, steps: int = STEPS) -> FloatArray:
        """Levenberg-Marquardt from the poses `(N, 4, 4)`."""
        w = np.ones(len(self.edges)) if weights is None else weights
        damping, cost = 1e-6, self._cost(poses, w)
        for _ in range(steps):
            J = self.jacobians(poses)
            gradient = self.gradient(J, w[:, None] * self.residuals(poses))
            while damping < MOST_DAMPED:
                step = self.factorised(J, w, damping).solve(-gradient).reshape(-1, 6)
                moved = poses @ se3.exp(step)
                new_cost = self._cost(moved, w)
                if new_cost <= cost:
                    break
                damping *= 10.0
            else:
                return poses
            decrease, poses, cost = cost - new_cost, moved, new_cost
            damping = max(damping / 10.0, 1e-9)
            if decrease <= CONVERGED * (cost + 1e-9):
                break
        return poses

    def perturbations(self, poses: FloatArray, weights: FloatArray, noise: FloatArray) -> FloatArray:
        """What noise of the edges does to the estimate: `(N, 6, S)` for whitened noise `(M, 6, S)`, to first order."""
        J = self.jacobians(poses)
        right = -self.gradient(J, weights[:, None, None] * noise)
        return self.factorised(J, weights, 0.0).solve(right).reshape(self.size, 6, -1)

    def _cost(self, poses: FloatArray, weights: FloatArray) -> float:
        return float(weights @ self.chi_squares(poses))


def _inverse_right_jacobian(xi: FloatArray) -> FloatArray:
    """Of the logarithm on SE(3), to second order: `I + ad / 2 + ad^2 / 12`."""
    ad = np.zeros((len(xi), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = se3.skew(xi[:, :3])
    ad[:, 3:, :3] = se3.skew(xi[:, 3:])
    return np.asarray(np.eye(6) + 0.5 * ad + (ad @ ad) / 12.0)


def _block_matrix(rows: IntArray, columns: IntArray, blocks: FloatArray, size: int) -> sp.csc_matrix:
    """Sum of 6 x 6 blocks."""
    if len(rows) == 0:
        return sp.csc_matrix((6 * size, 6 * size))
    order = np.argsort(rows * size + columns, kind="stable")
    keys = (rows * size + columns)[order]
    starts = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    summed = np.add.reduceat(blocks[order], starts, axis=0)
    unique_rows, unique_columns = keys[starts] // size, keys[starts] % size
    pointers = np.searchsorted(unique_rows, np.arange(size + 1))
    return sp.bsr_matrix((summed, unique_columns, pointers), shape=(6 * size, 6 * size)).tocsc()
