"""Cycles of two closures and the odometry between their ends: how far from closing, and how far noise allows.

Mangelson et al., "Pairwise consistent measurement set maximization", ICRA 2018, eq. 7: `z_ik^-1 x_ij z_jl x_lk` is the
identity for two perfect closures of one pair of robots.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.backends.closure_sets import ClosureSet
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.types import FloatArray, IntArray, Trajectory


@dataclass(frozen=True, eq=False)
class Cycles:
    """All cycles among the closures of two robots, row by row of their matrix.

    Args:
        closure_set: the closures.
        odometry_a, odometry_b: keyframe odometry of the robots, each in its own frame.
    """

    closure_set: ClosureSet
    odometry_a: Trajectory
    odometry_b: Trajectory

    @classmethod
    def of(cls, closure_set: ClosureSet, trajectories: Mapping[str, Trajectory]) -> Cycles:
        """The cycles over these robots' odometry."""
        return cls(closure_set, trajectories[closure_set.robot_a], trajectories[closure_set.robot_b])

    @cached_property
    def _T_odom_a(self) -> FloatArray:
        return self.odometry_a.poses[self.closure_set.index_a]

    @cached_property
    def _T_odom_b(self) -> FloatArray:
        return self.odometry_b.poses[self.closure_set.index_b]

    @cached_property
    def _T_odom_a_odom_b(self) -> FloatArray:
        """`(N, 4, 4)`: robot b's odometry frame in that of a, as each closure has it."""
        return np.asarray(self._T_odom_a @ self.closure_set.T_a_b @ se3.inverse(self._T_odom_b))

    @cached_property
    def _closure_covariance_odom_b(self) -> FloatArray:
        return se3.rotate_covariance(se3.adjoint(self._T_odom_b), self.closure_set.covariance)

    def closing_transforms(self, row: int, others: IntArray) -> FloatArray:
        """`z_ik^-1 x_ij z_jl x_lk` `(M, 4, 4)` of the closure `row` (i, k) with `others (M,)` (j, l)."""
        T_k_odom_b = se3.inverse(self._T_odom_b[row])
        T_k_odom_a = T_k_odom_b @ se3.inverse(self._T_odom_a_odom_b[row])
        return _between(T_k_odom_a, self._T_odom_a_odom_b[others], self._T_odom_b[row])

    def legacy_transforms(self, row: int, others: IntArray) -> FloatArray:
        """DiSCo-SLAM's `z_ik x_ij z_jl^-1 x_lk`, `(M, 4, 4)`.

        It stores each loop as source-to-target and multiplies it as target-to-source.  Perfect closures then leave a
        residual, unless the closure is its own inverse (no offset, heading equal or opposite).
        """
        x_ij = se3.between(self._T_odom_a[row], self._T_odom_a[others])
        x_lk = se3.between(self._T_odom_b[others], self._T_odom_b[row])
        return np.asarray(self.closure_set.T_a_b[row] @ x_ij @ se3.inverse(self.closure_set.T_a_b[others]) @ x_lk)

    def mahalanobis_squared(self, row: int, others: IntArray, *, limit: float = np.inf) -> FloatArray:
        """`e^T Sigma^-1 e` `(M,)` of the cycles' errors; what exceeds `limit` by its rotation alone is infinite.

        Sigma is that of both closures and both odometry segments to first order, each moved by its adjoint into frame
        k, where the cycle ends.  A segment's covariance is that of the relative pose, not the sum of both ends': it
        vanishes where two closures share a keyframe and grows with the way between them.
        """
        T = self.closing_transforms(row, others)
        near = np.flatnonzero(se3.rotation_angle(T) ** 2 <= limit * self._rotation_variance(row, others))
        squared = np.full(len(others), np.inf)
        squared[near] = mahalanobis_squared(se3.log(T[near]), self._covariance(row, others[near]))
        return squared

    def _rotation_variance(self, row: int, others: IntArray) -> FloatArray:
        """Trace of Sigma's rotation block, the same in every frame: bounds the distance from below at little cost."""
        a, b, of_closure = (
            self.closure_set.index_a,
            self.closure_set.index_b,
            _rotation_trace(self.closure_set.covariance),
        )
        along_a = self.odometry_a.rotation_variance_between(a[row], a[others])
        along_b = self.odometry_b.rotation_variance_between(b[row], b[others])
        return np.asarray(along_a + along_b + of_closure[others] + of_closure[row])

    def _covariance(self, row: int, others: IntArray) -> FloatArray:
        a, b, rows = self.closure_set.index_a, self.closure_set.index_b, np.full(len(others), row)
        T_k_odom_b = se3.inverse(self._T_odom_b[row])
        T_k_odom_a = T_k_odom_b @ se3.inverse(self._T_odom_a_odom_b[row])
        in_odom_a = self.odometry_a.drift_between(a[rows], a[others])
        in_odom_b = self.odometry_b.drift_between(b[rows], b[others]) + self._closure_covariance_odom_b[others]
        to_k_a, to_k_b = se3.adjoint(T_k_odom_a), se3.adjoint(T_k_odom_b)
        at_k = _between(to_k_a, in_odom_a, to_k_a.T) + _between(to_k_b, in_odom_b, to_k_b.T)
        return np.asarray(at_k + self.closure_set.covariance[row])


def _between(left: FloatArray, matrices: FloatArray, right: FloatArray) -> FloatArray:
    """`left @ M @ right` for many matrices `(M, K, K)` between the same two, as one product of large matrices."""
    size = left.shape[0]
    both_sides = np.einsum("ij,kl->jkil", left, right).reshape(size**2, size**2)
    return np.asarray((matrices.reshape(-1, size**2) @ both_sides).reshape(-1, size, size))


def _rotation_trace(covariance: FloatArray) -> FloatArray:
    return np.asarray(covariance[..., 0, 0] + covariance[..., 1, 1] + covariance[..., 2, 2])
