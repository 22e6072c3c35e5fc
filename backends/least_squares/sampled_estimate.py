"""An estimate with samples of its errors, and any edges against what it predicts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.linearised import Linearised
from wiclosure.backends.least_squares.system import Descent, System
from wiclosure.types import FloatArray

SAMPLES = 100  # of the noise: a sampled 6 x 6 covariance is then exact to some ten per cent
REDUNDANCY_FLOOR = 1e-5  # of a closure that nothing checks
EDGES_AT_ONCE = 1024  # bounds memory


@dataclass(frozen=True, eq=False)
class SampledEstimate:
    """Poses by the M edges of a system.

    Args:
        system: the edges.
        poses: `(N, 4, 4)`.
        moved: `(N, 6, S)` what noise does to the poses, as tangent vectors in the bodies.
    """

    system: System
    poses: FloatArray
    moved: FloatArray

    @classmethod
    def of(cls, system: System, noise: FloatArray, descent: Descent) -> SampledEstimate:
        """At the poses of a descent, by whitened noise `(M, D, S)` of the edges."""
        return cls(system, descent.poses, system.spread(descent, noise))

    def check(self, system: System, noise: FloatArray) -> Check:
        """The edges of a system, of which this one's are a part, with noise `(M, D, S)`."""
        poses, moved = self.poses, self.moved
        if len(self.system.free) == len(system.free):
            return Check.of(system, noise, poses, moved)
        flat = system.staying(poses)
        within = Check.of(*starting(system.subset(flat), noise[flat], poses), poses, moved)
        residuals, expected = np.zeros((2, len(flat), len(self.system.free)))
        residuals[flat], expected[flat], distance = within.residuals, within.expected, np.empty(len(flat))
        distance[flat] = within.distance
        distance[~flat] = Check.of(system.subset(~flat).moved_as(self.system), noise[~flat], poses, moved).distance
        return Check(residuals, expected, distance)


@dataclass(frozen=True, eq=False)
class Check:
    """Edges against what those in an estimate predict.

    Args:
        residuals: `(M, D)` whitened; zero where an edge leaves the plane that the estimate stays in.
        expected: `(M, D)` variances of these, as sampled.
        distance: `(M,)` squared Mahalanobis distances.
    """

    residuals: FloatArray
    expected: FloatArray
    distance: FloatArray

    @classmethod
    def of(cls, system: System, noise: FloatArray, poses: FloatArray, moved: FloatArray) -> Check:
        """By the samples `moved (N, 6, S)` that `noise (M, D, S)` makes of the poses `(N, 4, 4)`."""
        at, moved, height = (
            Linearised(system, poses, np.ones(len(system.edges))),
            moved[:, system.free],
            len(system.compared),
        )
        A, B = at.jacobians
        first, second, covariance = system.edges.first, system.edges.second, np.empty_like(system.W)
        for start in range(0, len(A), EDGES_AT_ONCE):
            rows = slice(start, start + EDGES_AT_ONCE)
            sampled = noise[rows] + A[rows] @ moved[first[rows]] + B[rows] @ moved[second[rows]]
            covariance[rows] = sampled @ np.swapaxes(sampled, 1, 2) / (SAMPLES - height - 1)
        covariance += REDUNDANCY_FLOOR * np.eye(height)
        expected = np.diagonal(covariance, axis1=1, axis2=2)
        return cls(at.residuals, expected, mahalanobis_squared(at.residuals, covariance))


def starting(system: System, noise: FloatArray, poses: FloatArray) -> tuple[System, FloatArray]:
    """`System.starting`, and of noise `(M, D, S)` the components that it compares."""
    flat = system.starting(poses)
    return flat, noise[:, np.searchsorted(system.compared, flat.compared)] if flat is not system else noise
