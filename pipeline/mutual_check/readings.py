"""Ways to read the log of two robots: with one systematic error undone, of a size that is known or is tried.

The errors are those of `wiclosure.wiclosure_filter.faults`.  There, a correction must speak for itself; here closures
tell where the robots are, so that errors of any size and parts of a log can be tried as well.  Sizes lie on a grid;
near the usual size all are tried, further out those that most residuals share.  Angles are equally likely all round.
Of lengths, factors and times nothing says whether they are large or small, so that each order of magnitude is equally
likely: the density falls as one over the size (Jaynes, "Probability Theory", ch. 12.4, on scale parameters).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.faults.corrections import (
    Correction,
    azimuths_off,
    clocks_apart,
    corrections,
    ranges_off,
    sigmas_too_small,
)
from wiclosure.wiclosure_filter.likelihood.residuals import mode
from wiclosure.wiclosure_filter.links.links import Links

_CLOCKS_S = tuple(s for s in np.arange(-4.0, 4.25, 0.25).tolist() if s)
_BIAS_STEP_M, _NEAR_BIAS_M = 0.5, 5.0
_SCALE_STEP, _NEAR_SCALE, _LEAST_SCALE, _MOST_SCALE = 0.02, 0.16, 0.1, 10.0
_AROUND = 2  # steps to either side of the size that most residuals share
_TURNS_RAD = tuple(np.radians([d for d in range(-170, 180, 10) if d % 90]).tolist())  # quarters are errors of their own
_LATE_S = tuple(s for s in np.arange(-5.0, 5.5, 0.5).tolist() if s)
_SIGMA_FACTORS = (3.0, 10.0, 100.0)


@dataclass(frozen=True, eq=False)
class Reading:
    """One systematic error.

    Args:
        corrections: what undoes it, for each size that is tried; exactly one of them holds.
        changes_alignment: whether the log, with it undone, may tell quite another alignment: that is searched for.
        sigmas: how large each size is beside the error that is usual; empty where no size is.
        widens: whether it widens standard deviations, for which no measurement must count for more.
        log_priors: logarithm of how likely each size was beforehand, among all of the grid, those included that are not
            tried because nothing suggests them; empty: all that are tried equally.
    """

    corrections: tuple[Correction, ...]
    changes_alignment: bool = False
    sigmas: tuple[float, ...] = ()
    widens: bool = False
    log_priors: tuple[float, ...] = ()

    @property
    def log_shares(self) -> FloatArray:
        """How likely each size was beforehand, as a natural logarithm."""
        return np.array(self.log_priors or [-np.log(len(self.corrections))] * len(self.corrections))


@dataclass(frozen=True, eq=False)
class Apart:
    """How far apart antennas were: `range_m (M,)` as measured, `distance_m (M,)` by where closures have the robots."""

    range_m: FloatArray
    distance_m: FloatArray

    @classmethod
    def of(cls, links: Links, T_a_b: FloatArray) -> Apart:
        """Of the measurements with a range, with the frame of b at `T_a_b (4, 4)` in that of a."""
        distance_m = np.linalg.norm(se3.transform(T_a_b, links.antenna_b) - links.antenna_a, axis=1)
        return cls(links.range_m[links.has_range], distance_m[links.has_range])

    @classmethod
    def unknown(cls) -> Apart:
        """Where nothing tells how far apart they were."""
        return cls(np.zeros(0), np.zeros(0))


def readings(
    robot_a: str,
    robot_b: str,
    log: WirelessLog,
    usual: CalibrationPriors | None = None,
    apart: Apart | None = None,
) -> list[Reading]:
    """All errors that the log of two robots may have, sized by what is usual of each, and by `apart`."""
    usual, apart = usual or CalibrationPriors(), apart or Apart.unknown()
    # Wider standard deviations make neighbouring measurements count for more, which is no evidence.
    clocks = _sized(lambda seconds: clocks_apart(robot_b, seconds), _CLOCKS_S, usual.clock_s)
    by_themselves = {c.fault for c in (*clocks.corrections, *map(sigmas_too_small, _SIGMA_FACTORS))}
    known = [c for c in corrections(robot_a, robot_b, log) if c.fault not in by_themselves]
    found = [Reading((correction,), correction.of_log) for correction in known]
    found += [clocks, _sized(_stamps_late, _LATE_S, usual.clock_s)]
    ranged, directed = (any(has(m) for m in log.measurements) for has in (_has_range, _has_paths))
    if ranged:
        found.append(_ranges_off(apart, usual.range_bias_m))
        found += [Reading((_ranges_times(factor),), True) for factor in (0.5, 2.0)]
        found.append(_ranges_scaled(apart, float(np.hypot(usual.range_scale, usual.scale))))
    if directed:
        found.append(_turned(usual.mounting_rad))
    if ranged and directed:
        found += [Reading((_DIRECTIONS_WRONG,), True), Reading((_RANGES_WRONG,), True)]
    return found


def readings_of_log(
    robot_a: str, robot_b: str, log: WirelessLog, usual: CalibrationPriors, apart: Apart
) -> list[Reading]:
    """Errors of the log alone, also of its standard deviations: for where closures have fixed the trajectories."""
    tried = [r for r in readings(robot_a, robot_b, log, usual, apart) if all(c.of_log for c in r.corrections)]
    found = [Reading(_about(r.corrections[0])) if r.corrections[0].log_scale else r for r in tried]
    alone = _ranges_less_exact, _directions_less_exact
    return [*found, *(Reading(tuple(map(of, _SIGMA_FACTORS)), widens=True) for of in (sigmas_too_small, *alone))]


def _sized(
    correction: Callable[[float], Correction], sizes: Sequence[float], usual: float, of_grid: Sequence[float] = ()
) -> Reading:
    """Of sizes whose density falls as one over the size, over those of the whole grid."""
    spread = np.log(np.sum(1.0 / np.abs(of_grid or sizes)))
    log_priors = tuple((-np.log(np.abs(sizes)) - spread).tolist())
    return Reading(tuple(map(correction, sizes)), sigmas=tuple(s / usual for s in sizes), log_priors=log_priors)


def _turned(usual_rad: float) -> Reading:
    """Of an antenna array, by any angle."""
    return Reading(tuple(map(azimuths_off, _TURNS_RAD)), sigmas=tuple(turn / usual_rad for turn in _TURNS_RAD))


def _ranges_off(apart: Apart, usual_m: float) -> Reading:
    """By any size up to that of the longest range."""
    most = max(float(np.max(apart.range_m, initial=0.0)), _NEAR_BIAS_M)
    sizes = _proposed(apart.range_m - apart.distance_m, _BIAS_STEP_M, _NEAR_BIAS_M)
    return _sized(ranges_off, sizes, usual_m, _grid(-most, most, _BIAS_STEP_M))


def _ranges_scaled(apart: Apart, usual: float) -> Reading:
    """By any factor from a tenth to ten."""
    there = apart.range_m > 0
    factors = apart.distance_m[there] / apart.range_m[there]
    sizes = _proposed(np.clip(factors, _LEAST_SCALE, _MOST_SCALE) - 1.0, _SCALE_STEP, _NEAR_SCALE)
    return _sized(_scaled_by, sizes, usual, _grid(_LEAST_SCALE - 1.0, _MOST_SCALE - 1.0, _SCALE_STEP))


def _grid(least: float, most: float, step: float) -> tuple[float, ...]:
    """Multiples of `step` but 0."""
    return tuple((step * np.array([n for n in range(round(least / step), round(most / step) + 1) if n])).tolist())


def _about(of_unit: Correction) -> tuple[Correction, ...]:
    """Of a unit, with ranges a few percent off besides: a map is no more exact than that, and any factor is tried."""

    def besides(size: float) -> Correction:
        scaled = _scaled_by(size)
        return replace(of_unit, apply=lambda inputs: scaled.apply(of_unit.apply(inputs)))

    return tuple(besides(n * _SCALE_STEP) for n in range(-_AROUND, _AROUND + 1))


def _proposed(residuals: FloatArray, step: float, near: float) -> tuple[float, ...]:
    """Sizes on the grid of `step`: all up to `near`, and those about the one that most residuals share."""
    steps = set(range(-round(near / step), round(near / step) + 1))
    if len(residuals):
        middle = round(float(mode(residuals, step)) / step)
        steps |= set(range(middle - _AROUND, middle + _AROUND + 1))
    return tuple(round(n * step, 9) for n in sorted(steps - {0}))


def _has_range(m: WirelessMeasurement) -> bool:
    return m.range_m is not None


def _has_paths(m: WirelessMeasurement) -> bool:
    return bool(m.paths)


def _each(fault: str, change: Callable[[WirelessMeasurement], WirelessMeasurement | None]) -> Correction:
    """Of every measurement; None leaves one out."""

    def changed(log: WirelessLog) -> WirelessLog:
        measurements = (change(m) for m in log.measurements)
        return replace(log, measurements=tuple(m for m in measurements if m is not None))

    return Correction(fault, lambda inputs: (inputs[0], changed(inputs[1])))


def _stamps_late(seconds: float) -> Correction:
    """Of a log whose clock is not that of the scans."""
    late_ns = round(seconds * 1e9)

    def shifted(m: WirelessMeasurement) -> WirelessMeasurement:
        sent_ns = None if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns - late_ns
        return replace(m, stamp_ns=m.stamp_ns - late_ns, transmitter_stamp_ns=sent_ns)

    side = "ahead of" if seconds > 0 else "behind"
    return _each(f"the log's stamps seem to be about {abs(seconds):g} s {side} those of the scans", shifted)


def _scaled_by(size: float) -> Correction:
    factor = 1.0 + size
    side = "long" if factor < 1 else "short"
    return _ranges_by(f"ranges are about {abs(100 / factor - 100):.0f} % too {side} for the odometry", factor)


def _ranges_less_exact(factor: float) -> Correction:
    def widened(m: WirelessMeasurement) -> WirelessMeasurement:
        return m if m.range_sigma_m is None else replace(m, range_sigma_m=factor * m.range_sigma_m)

    return _each(f"standard deviations of ranges seem to be about {factor:g} times too small", widened)


def _directions_less_exact(factor: float) -> Correction:
    def widened(m: WirelessMeasurement) -> WirelessMeasurement:
        return replace(m, paths=tuple(replace(p, sigma=max(p.sigma, min(factor * p.sigma, np.pi))) for p in m.paths))

    return _each(f"standard deviations of directions seem to be about {factor:g} times too small", widened)


def _ranges_times(factor: float) -> Correction:
    size = "twice" if factor < 1 else "half"
    fault = f"ranges are {size} the distance, as if time of flight were taken for the wrong way"
    return replace(_ranges_by(fault, factor), log_scale=float(np.log(factor)))


def _ranges_by(fault: str, factor: float) -> Correction:
    def scaled(m: WirelessMeasurement) -> WirelessMeasurement:
        return m if m.range_m is None else replace(m, range_m=factor * m.range_m)

    return _each(fault, scaled)


_DIRECTIONS_WRONG = _each(
    "directions of arrival are wrong", lambda m: replace(m, paths=()) if m.range_m is not None else None
)
_RANGES_WRONG = _each("ranges are wrong", lambda m: replace(m, range_m=None, range_sigma_m=None) if m.paths else None)
