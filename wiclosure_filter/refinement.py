"""Climbs from many proposed frame transforms to the peaks of the likelihood, all at once.

Expectation maximisation: the mixture says which path (or none) explains each measurement, a damped Gauss-Newton step
fits the transform to that, and so on.  The last step's normal matrix is the information of the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.mixture import Mixture
from wiclosure.wiclosure_filter.observations import Observations

_STEPS = 15
_DAMPING = 1e-3
_MIN_DISTANCE_M = 0.3
_CONVERGED = 1e-7


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before a measurement is looked at.

    Args:
        yaw: rad by the robots' headings, or NaN.
        yaw_sigma: rad.
        height_m: most likely `z` of the state: antennas at equal height.
        height_sigma_m: m.
    """

    yaw: float
    yaw_sigma: float
    height_m: float
    height_sigma_m: float

    @classmethod
    def of(cls, observations: Observations, height_sigma_m: float, use_headings: bool) -> Prior:
        """Prior of a set of observations; headings that repeat themselves do not add up."""
        known = np.isfinite(observations.yaw) & use_headings
        yaw = float(np.angle(np.exp(1j * observations.yaw[known]).sum())) if known.any() else np.nan
        sigma = float(np.median(observations.yaw_sigma[known])) if known.any() else np.nan
        return cls(yaw, sigma, 0.0, height_sigma_m)  # centred heights: equal on average is z = 0

    def log_density(self, states: FloatArray) -> FloatArray:
        """`(N,)`, up to a constant."""
        density = -((states[:, 3] - self.height_m) ** 2) / (2 * self.height_sigma_m**2)
        if np.isfinite(self.yaw):
            density += (np.cos(states[:, 0] - self.yaw) - 1) / self.yaw_sigma**2
        return np.asarray(density)

    def add_to(self, states: FloatArray, information: FloatArray, gradient: FloatArray) -> None:
        """Adds the prior to normal equations."""
        information[:, 3, 3] += self.height_sigma_m**-2
        gradient[:, 3] += (self.height_m - states[:, 3]) * self.height_sigma_m**-2
        if np.isfinite(self.yaw):
            information[:, 0, 0] += self.yaw_sigma**-2
            gradient[:, 0] += np.sin(self.yaw - states[:, 0]) * self.yaw_sigma**-2


@dataclass(frozen=True, eq=False)
class Peaks:
    """N local maxima of the posterior.

    Args:
        states: `(N, 4)`.
        log_posterior: `(N,)`.
        information: `(N, 4, 4)`, inverse covariances of the states.
    """

    states: FloatArray
    log_posterior: FloatArray
    information: FloatArray

    def __len__(self) -> int:
        return len(self.states)

    def subset(self, rows: FloatArray) -> Peaks:
        """The peaks at `rows`."""
        return Peaks(self.states[rows], self.log_posterior[rows], self.information[rows])


def climb(states: FloatArray, mixture: Mixture, prior: Prior) -> Peaks:
    """Refines states `(N, 4)` to the nearest peaks."""
    states = states.copy()
    best, best_value = states.copy(), mixture.log_likelihood(states) + prior.log_density(states)
    for _ in range(_STEPS):
        information, gradient = _normal_equations(states, mixture, prior)
        step = _solved(information, gradient)
        states = states + step
        value = mixture.log_likelihood(states) + prior.log_density(states)
        better = value > best_value
        best[better], best_value[better] = states[better], value[better]
        if np.abs(step).max(initial=0.0) < _CONVERGED:
            break
    information, _ = _normal_equations(best, mixture, prior)
    return Peaks(best, best_value, information)


def _solved(information: FloatArray, gradient: FloatArray) -> FloatArray:
    """Damped steps, at most half a radian and ten metres long."""
    diagonal = np.einsum("nii->ni", information)
    damped = information.copy()
    np.einsum("nii->ni", damped)[:] += _DAMPING * diagonal + 1e-6
    step = np.linalg.solve(damped, gradient[..., None])[..., 0]
    shrink = np.maximum(np.abs(step[:, 0]) / 0.5, np.linalg.norm(step[:, 1:], axis=1) / 10.0)
    return np.asarray(step / np.maximum(shrink, 1.0)[:, None])


def _normal_equations(states: FloatArray, mixture: Mixture, prior: Prior) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton information `(N, 4, 4)` and gradient `(N, 4)` under the current responsibilities."""
    rows = residual_rows(states, mixture)
    counted = mixture.observations.independence[None, :, None]
    weighted = rows.weight * counted
    information = np.einsum("nmr,nmri,nmrj->nij", weighted, rows.jacobian, rows.jacobian, optimize=True)
    gradient = np.einsum("nmr,nmr,nmri->ni", weighted, rows.residual, rows.jacobian, optimize=True)
    prior.add_to(states, information, gradient)
    return information, gradient


@dataclass(frozen=True, eq=False)
class ResidualRows:
    """Three residuals a measurement: azimuth, elevation, range (measured minus predicted), of N states.

    Args:
        residual, weight: `(N, M, 3)`; weights are expected inverse variances, 0 where nothing was measured.
        jacobian: `(N, M, 3, 4)` of the prediction by the state.
    """

    residual: FloatArray
    weight: FloatArray
    jacobian: FloatArray


def residual_rows(states: FloatArray, mixture: Mixture) -> ResidualRows:
    """Residuals, weights and Jacobians of all measurements at N states."""
    observations = mixture.observations
    turned, w = _displacements_in_a(states, observations)
    flat_distance = np.maximum(np.hypot(w[..., 0], w[..., 1]), _MIN_DISTANCE_M)
    distance = np.maximum(np.linalg.norm(w, axis=-1), _MIN_DISTANCE_M)
    path, in_sight, obstructed = mixture.responsibilities(states)

    shape = (*w.shape[:2], 3)
    residual, weight, jacobian = np.zeros(shape), np.zeros(shape), np.zeros((*shape, 4))
    by_w = np.zeros((*shape, 3))  # azimuth, elevation and range by the displacement
    by_w[..., 0, 0], by_w[..., 0, 1] = -w[..., 1] / flat_distance**2, w[..., 0] / flat_distance**2
    tilt = w[..., 2] / (flat_distance * distance**2)
    by_w[..., 1, 0], by_w[..., 1, 1] = -w[..., 0] * tilt, -w[..., 1] * tilt
    by_w[..., 1, 2] = flat_distance / distance**2
    by_w[..., 2, :] = w / distance[..., None]
    jacobian[..., 1:] = by_w
    jacobian[..., 0] = by_w[..., 1] * turned[..., None, 0] - by_w[..., 0] * turned[..., None, 1]
    back = ~observations.a_receives
    jacobian[:, back, 0, 0] -= 1.0
    jacobian[:, back, 1] *= -1.0

    azimuth = np.arctan2(w[..., 1], w[..., 0]) + np.where(back, np.pi - states[:, :1], 0.0)
    elevation = np.where(back, -1.0, 1.0) * np.arctan2(w[..., 2], flat_distance)
    measured = np.arctan2(observations.direction[..., 1], observations.direction[..., 0])
    rising = np.arcsin(np.clip(observations.direction[..., 2], -1, 1))
    path_weight = path * mixture.kappa
    weight[..., 0] = path_weight.sum(axis=-1)
    residual[..., 0] = _mean(path_weight, _wrapped(measured - azimuth[..., None]), weight[..., 0])
    path_weight = np.where(observations.flat, 0.0, path_weight)
    weight[..., 1] = path_weight.sum(axis=-1)
    residual[..., 1] = _mean(path_weight, rising - elevation[..., None], weight[..., 1])

    excess = np.nan_to_num(observations.range_m) - distance
    sure = in_sight / mixture.range_variance
    vague = obstructed / (mixture.range_variance + mixture.radio.range_bias_m**2)
    weight[..., 2] = sure + vague
    residual[..., 2] = excess - mixture.radio.range_bias_m * vague / np.maximum(weight[..., 2], 1e-12)
    return ResidualRows(residual, weight, jacobian)


def _displacements_in_a(states: FloatArray, observations: Observations) -> tuple[FloatArray, FloatArray]:
    """`R b (N, M, 3)` and antenna a to antenna b in a's odometry axes `(N, M, 3)`."""
    cosine, sine = np.cos(states[:, :1]), np.sin(states[:, :1])
    b = observations.b
    turned = np.empty((len(states), len(b), 3))
    turned[..., 0] = cosine * b[:, 0] - sine * b[:, 1]
    turned[..., 1] = sine * b[:, 0] + cosine * b[:, 1]
    turned[..., 2] = b[:, 2]
    return turned, turned + states[:, None, 1:] - observations.a


def _mean(weight: FloatArray, values: FloatArray, total: FloatArray) -> FloatArray:
    return np.asarray((weight * values).sum(axis=-1) / np.maximum(total, 1e-12))


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
