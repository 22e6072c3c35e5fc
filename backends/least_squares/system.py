"""Least squares over relative poses, and what the noise of the measurements does to the estimate.

Everything here is vectorised over the edges; the sparse normal equations are solved by `normal_matrix`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from wiclosure import se3
from wiclosure.backends.least_squares.edges import DEGREES, Edges, in_plane
from wiclosure.backends.least_squares.linearised import Linearised
from wiclosure.backends.least_squares.normal_matrix import Factorised, NormalMatrix
from wiclosure.types import BoolArray, FloatArray, IntArray

STEPS = 150  # of Levenberg-Marquardt, those taken back included
FEW_STEPS = 5  # in which it converges without gross outliers
CONVERGED = 1e-5  # relative decrease of the cost below which it has converged
LEAST_DAMPED = 1e-6
MOST_DAMPED = 1e8
AS_PREDICTED = 0.5  # share of the decrease that the linearised cost predicts, from which steps are damped less
LEAST_VARIANCE = 1e-12  # rad^2, m^2: covariances that are stated as singular can be inverted
IN_PLANE = np.array([2, 3, 4])  # yaw, x and y of a tangent vector
OUT_OF_PLANE = np.array([0, 1, 5])
ROUNDING = 1e-9  # correlation of errors in the plane with those out of it, which turned frames leave


@dataclass(frozen=True, eq=False)
class Descent:
    """What came of some steps.

    Args:
        poses: `(N, 4, 4)`.
        converged: whether the last step hardly lowered the cost.
        last: derivatives by both ends and normal equations of the last step, if it has converged undamped.
    """

    poses: FloatArray
    converged: bool
    last: tuple[tuple[FloatArray, FloatArray], Factorised] | None = None


@dataclass(frozen=True, eq=False)
class Pattern:
    """Where the normal matrix of edges over `size` nodes is not zero, whatever the nodes move in."""

    edges: Edges
    size: int

    @cached_property
    def normal(self) -> NormalMatrix:
        """With the order in which it is eliminated, which is found once."""
        return NormalMatrix.of(self.edges.first, self.edges.second, self.size)


@dataclass(frozen=True, eq=False)
class System:
    """Edges over `size` nodes, linearised where the poses are; the nodes `held` do not move.

    Args:
        edges: the measurements.
        size: number of nodes.
        held: nodes.
        flat: `(M,)` edges measured in the plane, with errors there independent of those out of it.
        free: components `(K,)` of the tangent vectors that the nodes move in: all six, or three in the plane.
        compared: components `(D,)` of the errors: the same, or all six where some edges leave the plane.
        W: `(M, D, D)` whiteners of these.
        pattern: of the normal matrix.
    """

    edges: Edges
    size: int
    held: IntArray
    flat: BoolArray
    free: IntArray
    compared: IntArray
    W: FloatArray
    pattern: Pattern

    @classmethod
    def of(cls, edges: Edges, poses: FloatArray, held: IntArray) -> System:
        """Of nodes that begin at the poses `(N, 4, 4)`; covariances are inverted once."""
        every = np.arange(DEGREES)
        pattern, W = Pattern(edges, len(poses)), whiteners(edges.covariance)
        return cls(edges, len(poses), np.asarray(held), _flat(edges), every, every, W, pattern).starting(poses)

    def subset(self, rows: BoolArray) -> System:
        """Of the edges at `rows`."""
        if rows.all():
            return self
        edges = self.edges.subset(rows)
        return replace(self, edges=edges, flat=self.flat[rows], W=self.W[rows], pattern=Pattern(edges, self.size))

    def starting(self, poses: FloatArray) -> System:
        """With three unknowns a node where all edges and the poses `(N, 4, 4)` to start from stay in the plane."""
        if len(self.free) < DEGREES or not self.staying(poses).all():
            return self
        return replace(self, free=IN_PLANE, compared=IN_PLANE, W=self.W[:, IN_PLANE[:, None], IN_PLANE])

    def staying(self, poses: FloatArray) -> BoolArray:
        """Which edges `(M,)` stay in the plane, as do the poses `(N, 4, 4)` of their ends."""
        return self.flat & in_plane(self.edges.predicted(poses))

    def moved_as(self, other: System) -> System:
        """With the unknowns of another one's nodes, which edges that leave the plane do not move."""
        return replace(self, free=other.free)

    @property
    def normal(self) -> NormalMatrix:
        """Where the normal matrix is not zero, and in what order it is eliminated."""
        return self.pattern.normal

    def residuals(self, poses: FloatArray) -> FloatArray:
        """Whitened errors `(M, D)`."""
        return self.whitened(self.edges.errors(poses))

    def whitened(self, errors: FloatArray) -> FloatArray:
        """`(M, D)` for `(M, 6)`."""
        return np.asarray((self.W @ errors[:, self.compared, None])[..., 0])

    def chi_squares(self, poses: FloatArray) -> FloatArray:
        """Squared Mahalanobis distances `(M,)`."""
        return np.asarray(np.sum(self.residuals(poses) ** 2, axis=1))

    def cost(self, poses: FloatArray) -> float:
        """Sum of the squared distances."""
        return float(self.chi_squares(poses).sum())

    def jacobians(self, poses: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Whitened derivatives `(M, D, K)` by perturbations of both ends in their bodies."""
        predicted = self.edges.predicted(poses)
        return self.derivatives(predicted, self.edges.errors_of(predicted))

    def derivatives(self, predicted: FloatArray, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same.

        Args:
            predicted: `(M, 4, 4)` of the edges, by some poses.
            errors: `(M, 6)` of these.
        """
        by_second = self.W @ _inverse_right_jacobian(errors)[:, self.compared[:, None], self.free]
        moved = se3.adjoint(se3.inverse(predicted))[:, self.free[:, None], self.free]
        return -by_second @ moved, by_second

    def gradient(self, jacobians: tuple[FloatArray, FloatArray], residuals: FloatArray) -> FloatArray:
        """`J^T r` `(N, K, ...)` for weighted residuals `(M, D, ...)`."""
        (count, height, *columns), width = residuals.shape, jacobians[0].shape[2]
        nodes = np.stack([self.edges.first, self.edges.second], axis=1)
        held = (width * nodes[:, None, :, None] + np.arange(width)).repeat(height, axis=1)
        entries, rows = np.concatenate(jacobians, axis=2).ravel(), 2 * width * np.arange(count * height + 1)
        J = sp.csr_array((entries, held.ravel(), rows), shape=(count * height, self.size * width))
        summed = J.T @ residuals.reshape(count * height, math.prod(columns))
        return np.asarray(summed).reshape(self.size, width, *columns)

    def solved(self, poses: FloatArray, weights: FloatArray | None = None, steps: int = STEPS) -> FloatArray:
        """Levenberg-Marquardt from the poses `(N, 4, 4)`.

        Edges of no weight are left out: false ones would join everything with everything, and fill the matrix.
        """
        w = np.ones(len(self.edges)) if weights is None else weights
        return self.subset(w > 0).starting(poses).descent(poses, w[w > 0], steps).poses

    def spread(self, descent: Descent, noise: FloatArray) -> FloatArray:
        """What noise does to an estimate: `(N, 6, S)` for whitened `(M, D, S)`, to first order.

        About where its last step began, if that was not damped: it hardly moved.
        """
        if descent.last:
            J, factorised = descent.last
        else:
            J = self.jacobians(descent.poses)
            factorised = self.normal.factorised(*J, np.ones(len(self.edges)), self.held, 0.0)
        return self.tangents(factorised.solve(-self.gradient(J, noise)))

    def tangents(self, moved: FloatArray) -> FloatArray:
        """Tangent vectors `(N, 6, ...)` of movements `(N, K, ...)`."""
        if len(self.free) == DEGREES:
            return moved
        tangents = np.zeros((len(moved), DEGREES, *moved.shape[2:]))
        tangents[:, self.free] = moved
        return tangents

    def descent(self, poses: FloatArray, w: FloatArray, steps: int = STEPS, converged: float = CONVERGED) -> Descent:
        """Levenberg-Marquardt from the poses, with the edges weighted by `w (M,)`.

        Until the cost decreases by a share of less than `converged`, with `steps` factorisations at most.
        """
        damping, at = 0.0, Linearised(self, poses, w)
        for _ in range(steps):
            factorised = self.normal.factorised(*at.jacobians, w, self.held, damping)
            step = factorised.solve(-at.gradient)
            moved = at.moved(step)
            decrease = at.cost - moved.cost
            if not decrease >= 0:
                damping = max(10.0 * damping, LEAST_DAMPED)
                if damping > MOST_DAMPED:
                    return Descent(at.poses, True)
                continue
            last = (at.jacobians, factorised) if damping == 0.0 else None
            if decrease >= AS_PREDICTED * (at.cost - at.predicted_cost(step)):
                damping = damping / 10.0 if damping > LEAST_DAMPED else 0.0
            if last:
                moved, decrease = moved.further(decrease, factorised, converged)
            at = moved
            if decrease <= converged * (at.cost + 1e-9):
                return Descent(at.poses, True, last)
        return Descent(at.poses, False)


def whiteners(covariance: FloatArray) -> FloatArray:
    """`(M, K, K)` matrices W with `W Sigma W^T = I`."""
    L = np.linalg.cholesky(covariance + LEAST_VARIANCE * np.eye(covariance.shape[-1]))
    return np.asarray(np.linalg.inv(L))


def _flat(edges: Edges) -> BoolArray:
    sigma = np.sqrt(np.diagonal(edges.covariance, axis1=1, axis2=2))
    coupled = np.abs(edges.covariance[:, IN_PLANE[:, None], OUT_OF_PLANE])
    apart = (coupled <= ROUNDING * sigma[:, IN_PLANE, None] * sigma[:, None, OUT_OF_PLANE]).all(axis=(1, 2))
    return np.asarray(apart & in_plane(edges.T))


def _inverse_right_jacobian(xi: FloatArray) -> FloatArray:
    """Of the logarithm on SE(3), to second order: `I + ad / 2 + ad^2 / 12`."""
    ad = np.zeros((len(xi), 6, 6))
    ad[:, :3, :3] = ad[:, 3:, 3:] = se3.skew(xi[:, :3])
    ad[:, 3:, :3] = se3.skew(xi[:, 3:])
    return np.asarray(np.eye(6) + 0.5 * ad + (ad @ ad) / 12.0)
