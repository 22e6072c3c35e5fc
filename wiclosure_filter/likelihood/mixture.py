"""How likely the measurements are under a frame transform: a mixture that lets the direct path be missing.

Bearings (paper, eqs. 3 and 5, with the sign of the exponent and kappa = 1/sigma^2 put right):

    p(paths | X) ~ p_absent + (1 - p_absent) sum_k w_k g_k exp(kappa_k (u_k . v/|v| - 1)),

at most one path of a measurement being the direct one; g_k is the von Mises density's peak over the uniform density.
Ranges: a Gaussian, a second one for the excess through obstacles, and a floor for gross errors.  All log-likelihoods
are relative to "this measurement says nothing": 0 is a measurement that might as well be absent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import i0e

from wiclosure.types import BoolArray, FloatArray, IntArray
from wiclosure.wiclosure_filter.config import RadioModel
from wiclosure.wiclosure_filter.likelihood.observations import Observations

MIN_DISTANCE_M = 0.3  # antennas do not come closer; keeps bearings of near robots from turning wild
_CHUNK = 400_000  # proposals x measurements x paths at a time: stays in the processor's cache


@dataclass(frozen=True, eq=False)
class Mixture:
    """The mixture with the widths that hold at each measurement.

    Args:
        observations: the measurements.
        radio: what is assumed of the radio.
        kappa: `(M, K)` concentration of each path, drift included.
        range_variance: `(M,)` m^2, drift included; infinite without a range.
        tells_height: whether the robots' difference in height is estimated at all.
    """

    observations: Observations
    radio: RadioModel
    kappa: FloatArray
    range_variance: FloatArray
    tells_height: bool

    @classmethod
    def of(
        cls, observations: Observations, radio: RadioModel, drift: tuple[FloatArray, FloatArray] | None = None
    ) -> Mixture:
        """The mixture at given drift (`PairOdometry.drift_from`), or without any."""
        position, yaw = drift if drift is not None else (np.zeros(len(observations)), np.zeros(len(observations)))
        bearing_drift = yaw**2 + (position / np.maximum(observations.distance_m, 1.0)) ** 2
        kappa = 1.0 / (observations.sigma**2 + bearing_drift[:, None])
        variance = np.where(np.isfinite(observations.range_m), observations.range_sigma_m**2 + position**2, np.inf)
        return cls(observations, radio, kappa, variance, observations.tells_height)

    def subset(self, rows: IntArray) -> Mixture:
        """The mixture of the measurements at `rows` only."""
        return replace(
            self,
            observations=self.observations.subset(rows),
            kappa=self.kappa[rows],
            range_variance=self.range_variance[rows],
        )

    def log_likelihood(self, states: FloatArray) -> FloatArray:
        """Log-likelihoods `(N,)` of N states `(N, 4)`."""
        size = max(1, _CHUNK // max(self.kappa.size, 1))
        parts = [self._chunk(states[i : i + size]) for i in range(0, len(states), size)]
        return np.concatenate(parts) if parts else np.zeros(0)

    def _chunk(self, states: FloatArray) -> FloatArray:
        """Single precision and few temporaries: this is where consensus spends its time."""
        v = displacement(states, self.observations, np.float32)
        flat_distance = np.sqrt(v[0] ** 2 + v[1] ** 2)
        distance = np.sqrt(flat_distance**2 + v[2] ** 2)
        total = np.zeros(distance.shape, np.float32)
        if self.observations.has_bearing.any():
            total += self._bearings(v, flat_distance, distance)
        if np.isfinite(self.range_variance).any():
            total += np.log(self.ranges(distance)[0])
        return np.asarray(total @ self.observations.independence.astype(np.float32), float)

    def _bearings(self, v: tuple[FloatArray, ...], flat_distance: FloatArray, distance: FloatArray) -> FloatArray:
        observations = self.observations
        mixture = np.full(distance.shape, self.radio.direct_path_absent, np.float32)
        inverse_flat = 1 / np.maximum(flat_distance, MIN_DISTANCE_M)
        inverse = 1 / np.maximum(distance, MIN_DISTANCE_M) if not observations.all_flat else inverse_flat
        gain = self.peak.astype(np.float32)
        kappa = self.kappa.astype(np.float32)
        u = observations.direction.astype(np.float32)
        for k in range(kappa.shape[1]):
            cosine = v[0] * u[:, k, 0] + v[1] * u[:, k, 1]
            if inverse is not inverse_flat:
                cosine += v[2] * u[:, k, 2]
            cosine *= np.where(observations.flat[:, k], inverse_flat, inverse)
            mixture += gain[:, k] * np.exp(kappa[:, k] * (cosine - 1))
        return np.asarray(np.where(observations.has_bearing, np.log(mixture), 0))

    @cached_property
    def peak(self) -> FloatArray:
        """`(M, K)` weight times peak density over uniform density, of each path."""
        density = np.where(self.observations.flat, 1 / i0e(self.kappa), 2 * self.kappa / -np.expm1(-2 * self.kappa))
        return np.asarray((1 - self.radio.direct_path_absent) * self.observations.weight * density)

    def ranges(self, distance: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Total, direct and biased parts `(N, M)`, relative to a gross error's density; 1, 0, 0 without a range."""
        range_m, variance, wide, direct, biased, floor = self._of_ranges.astype(distance.dtype)
        excess = range_m - distance
        in_sight = direct * np.exp(-(excess**2) / (2 * variance))
        obstructed = biased * np.exp(-((excess - self.radio.range_bias_m) ** 2) / (2 * wide))
        return floor + in_sight + obstructed, in_sight, obstructed

    @cached_property
    def _of_ranges(self) -> FloatArray:
        """`(6, M)` ranges, m, direct and biased ones' variances, m^2, these parts' peaks, and gross errors' density."""
        radio, ranged = self.radio, np.isfinite(self.range_variance)
        variance = np.where(ranged, self.range_variance, 1.0)
        wide = variance + radio.range_bias_m**2
        reach = (1 - radio.range_outlier) * radio.range_reach_m / np.sqrt(2 * np.pi)
        direct = (1 - radio.range_biased) * reach * ranged / np.sqrt(variance)
        biased = radio.range_biased * reach * ranged / np.sqrt(wide)
        floor = np.where(ranged, radio.range_outlier, 1.0)
        return np.stack([np.nan_to_num(self.observations.range_m), variance, wide, direct, biased, floor])

    def explain(self, v: FloatArray) -> Explanation:
        """Which part of the mixture explains each measurement, for displacements `(N, M, 3)` (see `Links`)."""
        observations = self.observations
        flat_distance, distance = distances(v)
        cosine = np.matmul(observations.direction, v[..., None])[..., 0]
        cosine /= np.where(observations.flat, flat_distance[..., None], distance[..., None])
        path = self.peak * np.exp(self.kappa * (cosine - 1))
        absent = np.where(observations.has_bearing, max(self.radio.direct_path_absent, 1e-12), 1.0)
        bearing = absent + path.sum(axis=-1)
        total, in_sight, obstructed = self.ranges(distance)
        log_likelihood = np.log(bearing) + np.log(np.maximum(total, 1e-12))
        total = np.maximum(total, 1e-300)
        return Explanation(log_likelihood, path / bearing[..., None], in_sight / total, obstructed / total)


def distances(v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Horizontal ones and those in space `(N, M)` of displacements `(N, M, 3)`, no shorter than antennas are apart."""
    squared = v[..., 0] ** 2 + v[..., 1] ** 2
    flat, in_space = np.sqrt(squared), np.sqrt(squared + v[..., 2] ** 2)
    return np.maximum(flat, MIN_DISTANCE_M), np.maximum(in_space, MIN_DISTANCE_M)


@dataclass(frozen=True, eq=False)
class Explanation:
    """What explains M measurements, for N states.

    Args:
        log_likelihood: `(N, M)`.
        path: `(N, M, K)` probability that each path is the direct one; the rest to 1 is "none of them".
        in_sight, obstructed: `(N, M)` probability that the range is direct, or went through an obstacle; the rest is a
            gross error.
    """

    log_likelihood: FloatArray
    path: FloatArray
    in_sight: FloatArray
    obstructed: FloatArray

    def subset(self, rows: IntArray) -> Explanation:
        """What explains the measurements at `rows`."""
        return Explanation(
            self.log_likelihood[:, rows], self.path[:, rows], self.in_sight[:, rows], self.obstructed[:, rows]
        )

    def at(self, state: int) -> Explanation:
        """What explains the measurements at one of the N states."""
        one = slice(state, state + 1)
        return Explanation(self.log_likelihood[one], self.path[one], self.in_sight[one], self.obstructed[one])

    def direct(self) -> IntArray:
        """`(M,)` the path that more likely than not is the direct one, or -1; of the first state."""
        best = np.argmax(self.path[0], axis=1)
        return np.where(self.path[0, np.arange(len(best)), best] > 0.5, best, -1)

    def ranged(self) -> BoolArray:
        """`(M,)` true where the range more likely than not is no gross error; of the first state."""
        return np.asarray(self.in_sight[0] + self.obstructed[0] > 0.5)


def displacement(
    states: FloatArray, observations: Observations, dtype: type[np.floating[Any]]
) -> tuple[FloatArray, ...]:
    """Receiver to transmitter in the receiver's odometry axes: x, y, z, each `(N, M)`, for states `(N, 4)`."""
    yaw, x, y, z = np.asarray(states.T[:, :, None], dtype)
    cosine, sine = np.cos(yaw), np.sin(yaw)
    a, b = np.asarray(observations.a, dtype), np.asarray(observations.b, dtype)
    w_x = cosine * b[:, 0] - sine * b[:, 1] + (x - a[:, 0])
    w_y = sine * b[:, 0] + cosine * b[:, 1] + (y - a[:, 1])
    w_z = b[:, 2] + (z - a[:, 2])
    if observations.a_receives.all():
        return w_x, w_y, w_z
    receives = observations.a_receives
    return (
        np.where(receives, w_x, -(cosine * w_x + sine * w_y)),
        np.where(receives, w_y, sine * w_x - cosine * w_y),
        np.where(receives, w_z, -w_z),
    )
