"""Relative pose measurements as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray, IntArray

DEGREES = 6  # of freedom of a pose
IN_PLANE = 1e-6  # rad, m: by rounding


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

    def predicted(self, poses: FloatArray) -> FloatArray:
        """The measurements `(M, 4, 4)` as the poses `(N, 4, 4)` have them."""
        return se3.between(poses[self.first], poses[self.second])

    def errors(self, poses: FloatArray) -> FloatArray:
        """Tangent vectors `(M, 6)` from each measurement to the poses `(N, 4, 4)`."""
        return self.errors_of(self.predicted(poses))

    def errors_of(self, predicted: FloatArray) -> FloatArray:
        """The same of `predicted (M, 4, 4)`."""
        return se3.log(se3.between(self.T, predicted))


def in_plane(T: FloatArray) -> BoolArray:
    """Which transforms `(..., 4, 4)` stay in the plane."""
    return np.asarray((np.abs(T[..., 2, :2]) < IN_PLANE).all(axis=-1) & (np.abs(T[..., 2, 3]) < IN_PLANE))


def degrees_of_freedom(*transforms: FloatArray) -> int:
    """3 where all transforms `(..., 4, 4)` stay in the plane, else 6: residuals of planar graphs have no others."""
    return 3 if all(in_plane(T).all() for T in transforms) else DEGREES


def degrees_of_true_ones(odometry: FloatArray, loops: FloatArray) -> int:
    """3 where odometry `(N, 4, 4)` and most loops `(M, 4, 4)` stay in the plane: those that leave it are false."""
    return degrees_of_freedom(odometry) if 2 * in_plane(loops).sum() >= len(loops) else DEGREES


def mahalanobis_squared(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """`e^T Sigma^-1 e` for stacks `(M, 6)` and `(M, 6, 6)`."""
    return np.asarray(np.einsum("mi,mi->m", error, np.linalg.solve(covariance, error[..., None])[..., 0]))
