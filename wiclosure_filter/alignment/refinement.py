"""Climbs from many proposed frame transforms to the peaks of the likelihood, all at once.

Expectation maximisation: the mixture says which path (or none) explains each measurement, a damped Gauss-Newton step
fits the transform to that, and so on.  The last step's normal matrix is the information of the result.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.types import BoolArray, FloatArray, IntArray
from wiclosure.wiclosure_filter.alignment.mixture import MIN_DISTANCE_M, Explanation, Mixture
from wiclosure.wiclosure_filter.alignment.observations import Observations
from wiclosure.wiclosure_filter.alignment.settings import AlignmentSettings

_FIRST_STEPS = 5
_LAST_STEPS = 15
SAME_PEAK_M = 0.3
_DAMPING = 1e-3
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
    def of(cls, observations: Observations, settings: AlignmentSettings, use_headings: bool) -> Prior:
        """Prior of a set of observations; headings that repeat themselves do not add up."""
        known = np.isfinite(observations.yaw) & use_headings
        yaw = float(np.angle(np.exp(1j * observations.yaw[known]).sum())) if known.any() else np.nan
        sigma = float(np.median(observations.yaw_sigma[known])) if known.any() else np.nan
        level = settings.height_ratio * observations.typical_distance_m
        height_sigma_m = settings.height_sigma_m if observations.tells_height else min(level, settings.height_sigma_m)
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

    @classmethod
    def at(cls, states: FloatArray, mixture: Mixture, prior: Prior) -> Peaks:
        """States as they are, with the posterior and its curvature there."""
        value, information, _ = _normal_equations(states, mixture, prior)
        return cls(states, value, information)

    def subset(self, rows: IntArray) -> Peaks:
        """The peaks at `rows`."""
        return Peaks(self.states[rows], self.log_posterior[rows], self.information[rows])

    def distinct(self, observations: Observations) -> Peaks:
        """Best first, without those that stand where a better one does."""
        ordered = self.subset(np.argsort(-self.log_posterior, kind="stable"))
        return ordered.subset(_apart(ordered.states, observations, len(ordered)))


def climb(states: FloatArray, mixture: Mixture, prior: Prior, finalists: int = 6) -> Peaks:
    """Refines states `(N, 4)` to the nearest peaks; only the `finalists` most promising go all the way."""
    climbed = _steps(states, mixture, prior, _FIRST_STEPS)
    finalist = climbed.distinct(mixture.observations).states[:finalists]
    return _steps(finalist, mixture, prior, _LAST_STEPS)


def _apart(states: FloatArray, observations: Observations, limit: int) -> IntArray:
    """Rows of the first `limit` states of which no two are the same place, nearly."""
    apart = displacement_m(states[:, None], states[None, :], observations) > SAME_PEAK_M
    kept: list[int] = []
    for row in range(len(states)):
        if len(kept) < limit and apart[row, kept].all():
            kept.append(row)
    return np.array(kept, np.int64)


def _steps(states: FloatArray, mixture: Mixture, prior: Prior, count: int) -> Peaks:
    """At most `count` steps uphill; the best of the way is kept."""
    best, best_value = states, np.full(len(states), -np.inf)
    best_information = np.zeros((len(states), 4, 4))
    for left in range(count, -1, -1):
        value, information, gradient = _normal_equations(states, mixture, prior)
        better = value > best_value
        best = np.where(better[:, None], states, best)
        best_value = np.where(better, value, best_value)
        best_information = np.where(better[:, None, None], information, best_information)
        step = _solved(information, gradient)
        if left == 0 or np.abs(step).max(initial=0.0) < _CONVERGED:
            break
        states = states + step
    return Peaks(best, best_value, best_information)


def _solved(information: FloatArray, gradient: FloatArray) -> FloatArray:
    """Damped steps, at most half a radian and ten metres long."""
    diagonal = np.einsum("nii->ni", information)
    damped = information.copy()
    np.einsum("nii->ni", damped)[:] += _DAMPING * diagonal + 1e-6
    step = np.linalg.solve(damped, gradient[..., None])[..., 0]
    shrink = np.maximum(np.abs(step[:, 0]) / 0.5, np.linalg.norm(step[:, 1:], axis=1) / 10.0)
    return np.asarray(step / np.maximum(shrink, 1.0)[:, None])


def _normal_equations(states: FloatArray, mixture: Mixture, prior: Prior) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log-posterior `(N,)`, Gauss-Newton information `(N, 4, 4)` and gradient `(N, 4)` at N states."""
    observations = mixture.observations
    turned, w = displacements_in_a(states, observations)
    rows = residual_rows(w, states[:, :1], mixture)
    jacobian = np.empty((*rows.by_w.shape[:-1], 4))
    jacobian[..., 1:] = rows.by_w
    jacobian[..., 0] = rows.by_yaw
    jacobian[..., 0] += rows.by_w[..., 1] * turned[..., None, 0] - rows.by_w[..., 0] * turned[..., None, 1]
    weighted = (rows.weight * observations.independence[:, None]).reshape(len(states), -1, 1)
    jacobian = jacobian.reshape(len(states), -1, 4)
    transposed = np.swapaxes(weighted * jacobian, 1, 2)
    information = transposed @ jacobian
    gradient = (transposed @ rows.residual.reshape(len(states), -1, 1))[..., 0]
    prior.add_to(states, information, gradient)
    value = rows.log_likelihood @ observations.independence + prior.log_density(states)
    return value, information, gradient


@dataclass(frozen=True, eq=False)
class ResidualRows:
    """Three residuals a measurement: azimuth, elevation, range (measured minus predicted), of N states.

    Args:
        log_likelihood: `(N, M)` of the measurements.
        residual, weight: `(N, M, 3)`; weights are expected inverse variances, 0 where nothing was measured.
        by_w: `(N, M, 3, 3)` derivative of the predictions by the displacement in a's axes.
        by_yaw: `(N, M, 3)` by the relative yaw at a fixed displacement.
    """

    log_likelihood: FloatArray
    residual: FloatArray
    weight: FloatArray
    by_w: FloatArray
    by_yaw: FloatArray


def residual_rows(w: FloatArray, yaw: FloatArray, mixture: Mixture) -> ResidualRows:
    """Residuals, weights and derivatives of all measurements.

    Args:
        w: `(N, M, 3)` antenna a to antenna b, in a's odometry axes.
        yaw: `(N, 1)` or `(N, M)` relative yaw.
        mixture: of the measurements.
    """
    observations = mixture.observations
    back = ~observations.a_receives
    explanation = mixture.explain(seen_by_receiver(w, yaw, back))
    flat_distance = np.maximum(np.hypot(w[..., 0], w[..., 1]), MIN_DISTANCE_M)
    distance = np.maximum(np.linalg.norm(w, axis=-1), MIN_DISTANCE_M)
    azimuth = np.arctan2(w[..., 1], w[..., 0]) + np.where(back, np.pi - yaw, 0.0)
    elevation = np.where(back, -1.0, 1.0) * np.arctan2(w[..., 2], flat_distance)
    residual, weight = measured_residuals(azimuth, elevation, distance, explanation, mixture)
    by_yaw = np.zeros(w.shape)
    by_yaw[:, back, 0] = -1.0
    by_w = derivative_by_displacement(w, flat_distance, distance)
    by_w[:, back, 1] *= -1.0
    if not mixture.tells_height:
        by_w[..., 2] = 0.0  # or the height would settle above or below by chance, and shift the rest
    return ResidualRows(explanation.log_likelihood, residual, weight, by_w, by_yaw)


def measured_residuals(
    azimuth: FloatArray, elevation: FloatArray, distance: FloatArray, explanation: Explanation, mixture: Mixture
) -> tuple[FloatArray, FloatArray]:
    """Residuals and weights `(N, M, 3)` of azimuth, elevation and range, from the predictions `(N, M)`."""
    observations = mixture.observations
    residual, weight = np.zeros((*azimuth.shape, 3)), np.zeros((*azimuth.shape, 3))
    measured = np.arctan2(observations.direction[..., 1], observations.direction[..., 0])
    path_weight = explanation.path * mixture.kappa
    weight[..., 0] = path_weight.sum(axis=-1)
    residual[..., 0] = _mean(path_weight, _wrapped(measured - azimuth[..., None]), weight[..., 0])
    if not observations.flat.all():
        rising = np.arcsin(np.clip(observations.direction[..., 2], -1, 1))
        path_weight = np.where(observations.flat, 0.0, path_weight)
        weight[..., 1] = path_weight.sum(axis=-1)
        residual[..., 1] = _mean(path_weight, rising - elevation[..., None], weight[..., 1])
    excess = np.where(np.isfinite(observations.range_m), observations.range_m, 0.0) - distance
    sure = explanation.in_sight / mixture.range_variance
    vague = explanation.obstructed / (mixture.range_variance + mixture.radio.range_bias_m**2)
    weight[..., 2] = sure + vague
    residual[..., 2] = excess - mixture.radio.range_bias_m * vague / np.maximum(weight[..., 2], 1e-12)
    return residual, weight


def derivative_by_displacement(w: FloatArray, flat_distance: FloatArray, distance: FloatArray) -> FloatArray:
    """Azimuth, elevation and range of w `(N, M, 3)`, derived by w: `(N, M, 3, 3)`."""
    by_w = np.zeros((*w.shape, 3))
    by_w[..., 0, 0], by_w[..., 0, 1] = -w[..., 1] / flat_distance**2, w[..., 0] / flat_distance**2
    tilt = w[..., 2] / (flat_distance * distance**2)
    by_w[..., 1, 0], by_w[..., 1, 1] = -w[..., 0] * tilt, -w[..., 1] * tilt
    by_w[..., 1, 2] = flat_distance / distance**2
    by_w[..., 2, :] = w / distance[..., None]
    return by_w


def seen_by_receiver(w: FloatArray, yaw: FloatArray, back: BoolArray) -> FloatArray:
    """Receiver to transmitter in the receiver's odometry axes."""
    if not back.any():
        return w
    cosine, sine = np.cos(yaw), np.sin(yaw)
    from_b = -np.stack(
        [cosine * w[..., 0] + sine * w[..., 1], cosine * w[..., 1] - sine * w[..., 0], w[..., 2]], axis=-1
    )
    return np.asarray(np.where(back[:, None], from_b, w))


def explained(state: FloatArray, mixture: Mixture) -> Explanation:
    """What explains each measurement at one state `(4,)`; leading dimension 1."""
    _, w = displacements_in_a(state[None], mixture.observations)
    return mixture.explain(seen_by_receiver(w, state[None, :1], ~mixture.observations.a_receives))


def displacements_in_a(states: FloatArray, observations: Observations) -> tuple[FloatArray, FloatArray]:
    """`R b (N, M, 3)` and antenna a to antenna b in a's odometry axes `(N, M, 3)`."""
    cosine, sine = np.cos(states[:, :1]), np.sin(states[:, :1])
    b = observations.b
    turned = np.empty((len(states), len(b), 3))
    turned[..., 0] = cosine * b[:, 0] - sine * b[:, 1]
    turned[..., 1] = sine * b[:, 0] + cosine * b[:, 1]
    turned[..., 2] = b[:, 2]
    return turned, turned + states[:, None, 1:] - observations.a


def displacement_m(states: FloatArray, others: FloatArray, observations: Observations) -> FloatArray:
    """Root mean square distance between the places that two transforms give to b's antennas, horizontally."""
    spread = (observations.b[:, :2] ** 2).sum(axis=1).mean()  # b is centred: turning and shifting do not mix
    turned = 2 * spread * (1 - np.cos(states[..., 0] - others[..., 0]))
    shifted = ((states[..., 1:3] - others[..., 1:3]) ** 2).sum(axis=-1)
    return np.asarray(np.sqrt(turned + shifted))


def _mean(weight: FloatArray, values: FloatArray, total: FloatArray) -> FloatArray:
    return np.asarray((weight * values).sum(axis=-1) / np.maximum(total, 1e-12))


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
