"""Measured minus predicted azimuths, elevations and ranges, with weights and derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray
from wiclosure.wiclosure_filter.likelihood.mixture import Explanation, Mixture, distances
from wiclosure.wiclosure_filter.likelihood.observations import Observations


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
    flat_distance, distance = distances(w)
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
    path_weight = explanation.path * mixture.kappa
    weight[..., 0] = path_weight.sum(axis=-1)
    residual[..., 0] = _mean(path_weight, se3.wrap_angle(observations.azimuth - azimuth[..., None]), weight[..., 0])
    if not observations.all_flat:
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


def _mean(weight: FloatArray, values: FloatArray, total: FloatArray) -> FloatArray:
    return np.asarray((weight * values).sum(axis=-1) / np.maximum(total, 1e-12))


def mode(values: np.ndarray, width: float) -> np.ndarray:
    """Mean of the values around the one that has most others near it."""
    near = np.abs(values[:, None] - values[None, :]) < width
    return np.asarray(values[near[np.argmax(near.sum(axis=1))]].mean())
