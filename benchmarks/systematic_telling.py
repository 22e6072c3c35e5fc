"""Whether a fault can be told at all: by the true paths, not by what the filter says of them.

Exact ranges and bearings along the true paths are spoiled as the log is.  A rigid transform that explains them within
the noise puts b elsewhere, and no measurement tells which of the two is right: robots that drive in parallel see the
same under a mirrored azimuth.  Odometry that is 2 % too long is no fault, so constant errors of the usual size excuse
the transform as they do in the filter.  A fault is *tellable* where the best transform misses by more than the odds
for which a fault is named (1000 to 1) and its rarity (1 log in 50) together.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from systematic_faults import Case, Fault
from systematic_worlds import AOA_SIGMA_RAD, RANGE_SIGMA_M, World, wrap

from wiclosure import se3
from wiclosure.types import AoaPath, FloatArray, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.drift.calibration import AZIMUTH_A, BIAS, CLOCK, RANGE_SCALE, SCALE_A, SCALE_B
from wiclosure.wiclosure_filter.drift.error_prior import ErrorPrior

ComplexArray: TypeAlias = NDArray[np.complex128]

LEAST_CHI2 = 2 * float(np.log(1000 * 50))
HEARD = 0.7  # of direct paths, at worst


def tellable(world: World, fault: Fault, rng: np.random.Generator) -> bool:
    """Whether exact measurements between a and b rule out that nothing is wrong."""
    ideal = Case(world.truth, world.truth, _exact(world))
    spoiled = fault.spoil(ideal, rng)
    a, b = spoiled.odometry["a"], spoiled.odometry["b"]
    # The filter leaves out what was measured while one of the odometries was not running.
    heard = [m for m in spoiled.log.measurements if all(t.covers(np.array([m.stamp_ns]))[0] for t in (a, b))]
    if not heard:
        return False
    rows = np.array([int(np.argmin(np.abs(a.stamps_ns - m.stamp_ns))) for m in heard])
    ranges = np.array([m.range_m for m in heard])
    azimuth = np.array([m.paths[0].azimuth for m in heard]) + se3.yaw(a.poses[rows])
    since = (a.stamps_ns[rows] - b.stamps_ns[0]) / 1e9
    seconds_b, path_b = (b.stamps_ns - b.stamps_ns[0]) / 1e9, b.positions[:, 0] + 1j * b.positions[:, 1]
    at_b, velocity_b = (np.interp(since, seconds_b, of) for of in (path_b, np.gradient(path_b, seconds_b)))
    at_a = a.positions[rows, 0] + 1j * a.positions[rows, 1]
    return HEARD * _chi2(Met(at_a, at_b, velocity_b, azimuth, ranges)) > LEAST_CHI2


@dataclass(frozen=True, eq=False)
class Met:
    """M measurements by a: where both are in their odometry, x + iy in metres, b's velocity, and what was measured."""

    at_a: ComplexArray
    at_b: ComplexArray
    velocity_b: ComplexArray
    azimuth: FloatArray
    ranges: FloatArray


def _exact(world: World) -> WirelessLog:
    """One exact path and range every so many poses."""
    a, b = world.truth["a"], world.truth["b"]
    rows = np.arange(0, len(a), world.every)
    seen = se3.between(a.poses[rows], b.poses[rows])[:, :3, 3]
    return WirelessLog(
        tuple(
            WirelessMeasurement(
                int(a.stamps_ns[row]),
                "a",
                "b",
                float(np.linalg.norm(p)),
                RANGE_SIGMA_M,
                (AoaPath(wrap(float(np.arctan2(p[1], p[0]))), AOA_SIGMA_RAD),),
            )
            for row, p in zip(rows, seen, strict=True)
        )
    )


def _chi2(met: Met) -> float:
    """By which the best rigid transform and usual errors miss the measurements, along and across these."""
    along = np.exp(-1j * met.azimuth)
    across_m = np.maximum(AOA_SIGMA_RAD * met.ranges, RANGE_SIGMA_M)
    usual = ErrorPrior.of(CalibrationPriors()).usual[[BIAS, RANGE_SCALE, CLOCK, AZIMUTH_A, SCALE_A, SCALE_B]]

    def missed(unknown: FloatArray) -> FloatArray:
        (turn, x, y), (bias, scale, clock, mounted, scale_a, scale_b) = unknown[:3], unknown[3:] * usual
        seen = (met.ranges - bias) / (1 + scale) * np.exp(1j * (met.azimuth - mounted))
        b = np.exp(1j * turn) * ((1 + scale_b) * met.at_b + clock * met.velocity_b) + x + 1j * y
        off = ((1 + scale_a) * met.at_a + seen - b) * along
        return np.concatenate([off.real / RANGE_SIGMA_M, off.imag / across_m, unknown[3:]])

    p, q = met.at_a + met.ranges * np.exp(1j * met.azimuth), met.at_b
    turn = float(np.angle(np.sum((p - p.mean()) * np.conj(q - q.mean()))))
    shift = p.mean() - np.exp(1j * turn) * q.mean()
    return 2 * float(optimize.least_squares(missed, [turn, shift.real, shift.imag, *np.zeros(len(usual))]).cost)
