"""Joint covariance of a pose graph whose robots' odometry chains meet only at links, in factored form.

Nodes without a link have neighbours in their own chain only, so their part of the information matrix is banded.
Eliminating them leaves a dense problem over the linked nodes alone; every other node's error is a linear function of
those plus an independent remainder.  Exact, and many times faster than inverting the whole matrix.
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, solveh_banded
from scipy.sparse import csr_array

from wiclosure.types import FloatArray, IntArray

# Blocks of 6 that touch at most the block next to them.
BAND = 12


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariances of K poses, rotation first.

    Args:
        own: `(K, 6, 6)` of each pose.
        factor: `(K, 6, r)`; for poses n, m of different robots the covariance is `factor[n] @ factor[m].T`.
    """

    own: FloatArray
    factor: FloatArray

    @classmethod
    def of(cls, linear: gtsam.GaussianFactorGraph, linked: NDArray[np.bool_]) -> JointCovariance:
        """From the linearised graph over poses 0 ... K-1, chain by chain; `linked (K,)` marks those with links.

        Raises:
            numpy.linalg.LinAlgError: some pose is not determined.
        """
        free, held = np.flatnonzero(~linked), np.flatnonzero(linked)
        ordering = gtsam.Ordering()
        for key in (*free, *held):
            ordering.push_back(int(key))
        information, _ = linear.hessian(ordering)
        split = 6 * len(free)
        response, remainder = _eliminated(information[:split, :split], information[:split, split:])
        of_held = information[split:, split:] + csr_array(information[split:, :split]) @ response
        # With information L L^T the covariance is L^-T L^-1: L^-T is the factor.
        lower = np.linalg.cholesky(of_held)
        inverse, _ = lapack.dtrtri(lower, lower=True)
        factor_held = np.ascontiguousarray(inverse.T)
        factor = np.empty((len(linked), 6, factor_held.shape[1]))
        factor[held] = factor_held.reshape(len(held), 6, len(lower))
        factor[free] = (response @ factor_held).reshape(len(free), 6, len(lower))
        own = factor @ np.swapaxes(factor, 1, 2)
        own[free] += remainder
        return cls(own, factor)

    def turned(self, R: FloatArray) -> JointCovariance:
        """In other axes: each pose's rotation and translation errors turned by `R (K, 3, 3)`."""
        turn = np.zeros((len(R), 6, 6))
        turn[:, :3, :3] = turn[:, 3:, 3:] = R
        return JointCovariance(turn @ self.own @ np.swapaxes(turn, 1, 2), turn @ self.factor)

    def widened(self, columns: FloatArray) -> JointCovariance:
        """With what independent errors of one standard deviation add, that move the poses by `columns (K, 6, E)`."""
        own = self.own + columns @ np.swapaxes(columns, 1, 2)
        return JointCovariance(own, np.concatenate([self.factor, columns], axis=2))

    def of_displacements(self, a: slice, b: slice, dimensions: int) -> FloatArray:
        """Covariance `(A, B, d, d)` of the difference of positions, for poses of two robots in common axes."""
        axes = slice(3, 3 + dimensions)
        own_a, own_b = self.own[a, axes, axes], self.own[b, axes, axes]
        flat_a, flat_b = (self.factor[rows, axes].reshape(-1, self.factor.shape[2]) for rows in (a, b))
        cross = (flat_a @ flat_b.T).reshape(len(own_a), dimensions, len(own_b), dimensions).swapaxes(1, 2)
        return np.asarray(own_a[:, None] + own_b[None, :] - cross - np.swapaxes(cross, 2, 3))

    def between(self, n: IntArray, m: IntArray) -> FloatArray:
        """Covariances `(M, 6, 6)` of the errors of poses n with those of poses m of another robot."""
        codes, inverse = np.unique(n * len(self.own) + m, return_inverse=True)
        rows, columns = np.divmod(codes, len(self.own))
        blocks = np.empty((len(codes), 6, 6))
        for start in range(0, len(codes), 1000):  # bounds the memory
            part = slice(start, start + 1000)
            blocks[part] = self.factor[rows[part]] @ np.swapaxes(self.factor[columns[part]], 1, 2)
        return blocks[inverse]


def _eliminated(banded: FloatArray, coupling: FloatArray) -> tuple[csr_array, FloatArray]:
    """How free poses follow held ones, `(6 F, 6 H)`, and the covariance `(F, 6, 6)` of what remains.

    A free pose follows only the held ones before and after it: the first result is sparse.
    """
    size = len(banded)
    if size == 0:
        return csr_array(coupling), np.zeros((0, 6, 6))
    bands = np.zeros((min(BAND, size), size))
    for offset in range(len(bands)):
        bands[offset, : size - offset] = np.diagonal(banded, -offset)
    solved = solveh_banded(bands, np.hstack([-coupling, np.eye(size)]), lower=True)
    inverse = solved[:, coupling.shape[1] :].reshape(size // 6, 6, size // 6, 6)
    return csr_array(solved[:, : coupling.shape[1]]), np.einsum("ninj->nij", inverse)
