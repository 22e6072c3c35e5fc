"""All of SE(3): frame transforms between odometry frames that do not agree on the vertical.

Starts are the peaks found with level frames, which do for moderate tilts, and, where elevations were measured, the
rigid motions that bring three correspondences together, which do for any.  Then the same expectation maximisation as in
`refinement`, over six degrees of freedom, with a weak prior that odometry frames are not upside down.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.consensus.proposals import Correspondences
from wiclosure.wiclosure_filter.consensus.refinement import (
    SAME_PEAK_M,
    Peaks,
    Prior,
    displacement_m,
    first_distinct,
)
from wiclosure.wiclosure_filter.likelihood.mixture import MIN_DISTANCE_M, Explanation, Mixture
from wiclosure.wiclosure_filter.likelihood.residuals import derivative_by_displacement, measured_residuals
from wiclosure.wiclosure_filter.links.links import Links

_STEPS = 20
_TRIPLES = 3_000
_STARTS = 12
_SEED = 20_231


@dataclass(frozen=True, eq=False)
class SpatialPeaks:
    """N local maxima over SE(3), best first.

    Args:
        T_a_b: `(N, 4, 4)` between the odometry frames.
        covariance: `(N, 6, 6)` of those, as errors in b's odometry frame.
        level: the same peaks seen as level ones (yaw and translation, tilt marginalised), for the ambiguity guard.
        explanation: what explains the measurements at each peak.
    """

    T_a_b: FloatArray
    covariance: FloatArray
    level: Peaks
    explanation: Explanation


def refine_in_space(level: Peaks, mixture: Mixture, prior: Prior, links: Links, tilt_sigma_rad: float) -> SpatialPeaks:
    """Climbs from level peaks, and from triples of correspondences, to the peaks over SE(3).

    Args:
        level: peaks with level frames.
        mixture: likelihood that they were found with.
        prior: on height, where the radio does not tell it.
        links: the same measurements.
        tilt_sigma_rad: rad, prior on roll and pitch between the frames.
    """
    problem = _SpatialProblem.of(mixture, prior, links, tilt_sigma_rad)
    starts = np.concatenate([se3.from_yaw(level.states[:, 0], level.states[:, 1:]), _from_triples(problem)])
    values = np.concatenate([problem.log_posterior(starts[i : i + 200])[0] for i in range(0, len(starts), 200)])
    X = starts[np.argsort(-values, kind="stable")[: 10 * _STARTS]]
    X = _distinct(X, problem)
    for _ in range(_STEPS):
        information, gradient = problem.normal_equations(X)
        step = np.linalg.solve(information, gradient[..., None])[..., 0]
        length = np.maximum(np.linalg.norm(step[:, :3], axis=1) / 0.5, np.linalg.norm(step[:, 3:], axis=1) / 10.0)
        X = X @ se3.exp(step / np.maximum(length, 1.0)[:, None])
    value, _ = problem.log_posterior(X)
    X = X[np.argsort(-value, kind="stable")]
    X = _distinct(X, problem)
    return problem.peaks(X)


@dataclass(frozen=True, eq=False)
class _SpatialProblem:
    """The likelihood over centred transforms X `(N, 4, 4)`: `X b` meets `a + w`."""

    mixture: Mixture
    R_axes_odom: FloatArray
    height_sigma_m: float
    tilt_sigma_rad: float

    @classmethod
    def of(cls, mixture: Mixture, prior: Prior, links: Links, tilt_sigma_rad: float) -> _SpatialProblem:
        """Directions go back into the axes in which they were measured: an azimuth means nothing in others."""
        R_axes_odom = np.swapaxes(links.R_odom_axes, 1, 2)
        in_axes = np.einsum("mij,mkj->mki", R_axes_odom, links.direction)
        return cls(
            replace(mixture, observations=mixture.observations.directed(in_axes)),
            R_axes_odom,
            prior.height_sigma_m,
            tilt_sigma_rad,
        )

    def log_posterior(self, X: FloatArray) -> tuple[FloatArray, Explanation]:
        """`(N,)`, and what explains the measurements."""
        explanation = self.mixture.explain(self._displacement(X)[0])
        value = explanation.log_likelihood @ self.mixture.observations.independence
        value -= (X[:, :2, 2] ** 2).sum(axis=1) / (2 * self.tilt_sigma_rad**2)
        return value - X[:, 2, 3] ** 2 / (2 * self.height_sigma_m**2), explanation

    def normal_equations(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Information `(N, 6, 6)` and gradient `(N, 6)` by `X exp(xi)`."""
        v, by_xi = self._displacement(X)
        flat_distance = np.maximum(np.hypot(v[..., 0], v[..., 1]), MIN_DISTANCE_M)
        distance = np.maximum(np.linalg.norm(v, axis=-1), MIN_DISTANCE_M)
        azimuth, elevation = np.arctan2(v[..., 1], v[..., 0]), np.arctan2(v[..., 2], flat_distance)
        explanation = self.mixture.explain(v)
        residual, weight = measured_residuals(azimuth, elevation, distance, explanation, self.mixture)
        jacobian = derivative_by_displacement(v, flat_distance, distance) @ by_xi
        weighted = (weight * self.mixture.observations.independence[:, None]).reshape(len(X), -1, 1)
        jacobian = jacobian.reshape(len(X), -1, 6)
        transposed = np.swapaxes(weighted * jacobian, 1, 2)
        information, gradient = transposed @ jacobian, (transposed @ residual.reshape(len(X), -1, 1))[..., 0]
        tilting = -X[:, :2, :3] @ se3.skew(np.array([0.0, 0.0, 1.0]))  # of X's z axis in the plane
        information[:, :3, :3] += np.swapaxes(tilting, 1, 2) @ tilting / self.tilt_sigma_rad**2
        gradient[:, :3] -= np.einsum("nij,ni->nj", tilting, X[:, :2, 2]) / self.tilt_sigma_rad**2
        rising = X[:, 2, :3]
        information[:, 3:, 3:] += rising[:, :, None] * rising[:, None, :] / self.height_sigma_m**2
        gradient[:, 3:] -= rising * X[:, 2, 3, None] / self.height_sigma_m**2
        return information + 1e-6 * np.eye(6), gradient

    def peaks(self, X: FloatArray) -> SpatialPeaks:
        """What the rest of the alignment needs to know of the optima X."""
        observations = self.mixture.observations
        value, explanation = self.log_posterior(X)
        information, _ = self.normal_equations(X)
        covariance = np.asarray(np.linalg.inv(information), float)
        to_a, to_b = (se3.from_yaw(0.0, centre) for centre in (observations.centre_a, observations.centre_b))
        to_level = np.zeros((len(X), 4, 6))
        to_level[:, 0, :3], to_level[:, 1:, 3:] = X[:, 2, :3], X[:, :3, :3]
        level = np.asarray(np.linalg.inv(se3.rotate_covariance(to_level, covariance)), float)
        states = np.column_stack([se3.yaw(X), X[:, :3, 3]])
        return SpatialPeaks(
            T_a_b=to_a @ X @ se3.inverse(to_b),
            covariance=se3.rotate_covariance(se3.adjoint(to_b), covariance),
            level=Peaks(states, value, level),
            explanation=explanation,
        )

    def _displacement(self, X: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Receiver to transmitter in the axes of the angles `(N, M, 3)`, and its derivative `(N, M, 3, 6)` by xi."""
        observations = self.mixture.observations
        a, b, receives = observations.a, observations.b, observations.a_receives[:, None]
        seen_by_a = se3.transform(X[:, None], b) - a
        a_in_b = se3.transform(se3.inverse(X)[:, None], a)
        v = np.where(receives, seen_by_a, a_in_b - b)
        R = np.broadcast_to(X[:, None, :3, :3], (len(X), len(a), 3, 3))
        from_a = np.concatenate([-R @ se3.skew(b), R], axis=-1)
        from_b = np.concatenate([se3.skew(a_in_b), np.broadcast_to(-np.eye(3), R.shape)], axis=-1)
        by_xi = np.where(receives[..., None], from_a, from_b)
        return np.einsum("mij,nmj->nmi", self.R_axes_odom, v), self.R_axes_odom @ by_xi


def _from_triples(problem: _SpatialProblem) -> FloatArray:
    """Rigid motions `(N, 4, 4)` that best bring three correspondences with elevation together (Kabsch 1976)."""
    observations = problem.mixture.observations
    in_odom = np.einsum("mji,mkj->mki", problem.R_axes_odom, observations.direction)
    points = Correspondences.of(observations.directed(in_odom))
    full = np.flatnonzero(~observations.flat[points.row, points.column])
    if len(np.unique(points.row[full])) < 3:
        return np.zeros((0, 4, 4))
    triple = full[np.random.default_rng(_SEED).integers(0, len(full), (_TRIPLES, 3))]
    row = points.row[triple]
    triple = triple[(row[:, 0] != row[:, 1]) & (row[:, 1] != row[:, 2]) & (row[:, 0] != row[:, 2])]
    a, b, sigma = points.a[triple], points.b[triple], points.sigma_m[triple].mean(axis=1)
    mean_a, mean_b = a.mean(axis=1), b.mean(axis=1)
    U, _, Vt = np.linalg.svd(np.swapaxes(a - mean_a[:, None], 1, 2) @ (b - mean_b[:, None]))
    U[:, :, 2] *= np.linalg.det(U @ Vt)[:, None]
    R = U @ Vt
    X = se3.from_rotation_translation(R, mean_a - np.einsum("nij,nj->ni", R, mean_b))
    misfit = np.linalg.norm(se3.transform(X[:, None], b) - a, axis=-1).max(axis=1)
    return np.asarray(X[misfit < 3 * sigma])


def _distinct(X: FloatArray, problem: _SpatialProblem) -> FloatArray:
    """The first few transforms of which no two are the same."""
    observations = problem.mixture.observations
    states = np.column_stack([se3.yaw(X), X[:, :3, 3]])
    spread = np.sqrt((observations.b**2).sum(axis=1).mean())

    def distances_to(row: int) -> FloatArray:
        tilted = spread * np.linalg.norm(X[row, :3, 2] - X[:, :3, 2], axis=-1)
        return np.asarray(np.hypot(tilted, displacement_m(states[row], states, observations)))

    return X[first_distinct(len(X), distances_to, SAME_PEAK_M, limit=_STARTS)]
