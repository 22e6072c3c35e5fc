"""Whether a fault can be told at all: by the true paths, not by what the filter says of them.

Exact ranges and bearings along the true paths are spoiled as the log is.  A rigid transform that explains them within
the noise puts b elsewhere, and no measurement tells which of the two is right: robots that drive in parallel see the
same under a mirrored azimuth.  A fault is *tellable* where the best rigid transform misses by more than the odds for
which a fault is named (1000 to 1) and its rarity (1 log in 50) together.
"""

from __future__ import annotations

import numpy as np
from scipy import optimize
from systematic_faults import Case, Fault
from systematic_worlds import AOA_SIGMA_RAD, RANGE_SIGMA_M, World, wrap

from wiclosure import se3
from wiclosure.types import AoaPath, FloatArray, WirelessLog, WirelessMeasurement

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
    seen = a.positions[rows, :2] + ranges[:, None] * np.column_stack([np.cos(azimuth), np.sin(azimuth)])
    since = (a.stamps_ns[rows] - b.stamps_ns[0]) / 1e9
    at_b = np.column_stack([np.interp(since, (b.stamps_ns - b.stamps_ns[0]) / 1e9, b.positions[:, k]) for k in (0, 1)])
    return HEARD * _chi2(seen, at_b, azimuth, ranges) > LEAST_CHI2


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


def _chi2(seen: FloatArray, at_b: FloatArray, azimuth: FloatArray, ranges: FloatArray) -> float:
    """By which the best rigid transform of `at_b (M, 2)` misses `seen (M, 2)`, along and across what was measured."""
    along = np.exp(-1j * azimuth)
    p, q = (points[:, 0] + 1j * points[:, 1] for points in (seen, at_b))
    across_m = np.maximum(AOA_SIGMA_RAD * ranges, RANGE_SIGMA_M)

    def missed(transform: FloatArray) -> FloatArray:
        off = (p - np.exp(1j * transform[0]) * q - transform[1] - 1j * transform[2]) * along
        return np.concatenate([off.real / RANGE_SIGMA_M, off.imag / across_m])

    turn = float(np.angle(np.sum((p - p.mean()) * np.conj(q - q.mean()))))
    shift = p.mean() - np.exp(1j * turn) * q.mean()
    return 2 * float(optimize.least_squares(missed, [turn, shift.real, shift.imag]).cost)
