"""Ways to read the log of two robots: with one systematic error undone, of a size that is known or is tried.

The errors are those of `wiclosure.wiclosure_filter.faults`.  There, a correction must speak for itself; here closures
tell where the robots are, so that errors of any size and parts of a log can be tried as well.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.types import WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.faults.corrections import (
    Correction,
    azimuths_off,
    clocks_apart,
    corrections,
    ranges_off,
    sigmas_too_small,
)

_CLOCKS_S = tuple(s for s in np.arange(-4.0, 4.25, 0.25).tolist() if s)
_BIASES_M = tuple(m for m in np.arange(-5.0, 5.5, 0.5).tolist() if m)
_SCALES = tuple(s for s in np.round(np.arange(-0.16, 0.17, 0.02), 2).tolist() if s)
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
    """

    corrections: tuple[Correction, ...]
    changes_alignment: bool = False
    sigmas: tuple[float, ...] = ()
    widens: bool = False


def readings(robot_a: str, robot_b: str, log: WirelessLog, usual: CalibrationPriors | None = None) -> list[Reading]:
    """All errors that the log of two robots may have, sized by what is usual of each."""
    usual = usual or CalibrationPriors()
    # Wider standard deviations make neighbouring measurements count for more, which is no evidence.
    clocks = _sized(lambda seconds: clocks_apart(robot_b, seconds), _CLOCKS_S, usual.clock_s)
    apart = {c.fault for c in (*clocks.corrections, *map(sigmas_too_small, _SIGMA_FACTORS))}
    known = [c for c in corrections(robot_a, robot_b, log) if c.fault not in apart]
    found = [Reading((correction,), correction.of_log) for correction in known]
    found += [clocks, _sized(_stamps_late, _LATE_S, usual.clock_s)]
    ranged, directed = (any(has(m) for m in log.measurements) for has in (_has_range, _has_paths))
    if ranged:
        found.append(_sized(ranges_off, _BIASES_M, usual.range_bias_m))
        found += [Reading((_ranges_times(factor),), True) for factor in (0.5, 2.0)]
        found.append(
            _sized(lambda size: _ranges_scaled(1.0 + size), _SCALES, float(np.hypot(usual.range_scale, usual.scale)))
        )
    if directed:
        found.append(_sized(azimuths_off, _TURNS_RAD, usual.mounting_rad))
    if ranged and directed:
        found += [Reading((_DIRECTIONS_WRONG,), True), Reading((_RANGES_WRONG,), True)]
    return found


def readings_of_log(robot_a: str, robot_b: str, log: WirelessLog, usual: CalibrationPriors) -> list[Reading]:
    """Errors of the log alone, also of its standard deviations: for where closures have fixed the trajectories."""
    found = [r for r in readings(robot_a, robot_b, log, usual) if all(c.of_log for c in r.corrections)]
    return [*found, *(Reading((sigmas_too_small(factor),), widens=True) for factor in _SIGMA_FACTORS)]


def _sized(correction: Callable[[float], Correction], sizes: Sequence[float], usual: float) -> Reading:
    return Reading(tuple(map(correction, sizes)), sigmas=tuple(size / usual for size in sizes))


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


def _ranges_scaled(factor: float) -> Correction:
    side = "long" if factor < 1 else "short"
    return _ranges_by(f"ranges are about {abs(100 / factor - 100):.0f} % too {side} for the odometry", factor)


def _ranges_times(factor: float) -> Correction:
    size = "twice" if factor < 1 else "half"
    return _ranges_by(f"ranges are {size} the distance, as if time of flight were taken for the wrong way", factor)


def _ranges_by(fault: str, factor: float) -> Correction:
    def scaled(m: WirelessMeasurement) -> WirelessMeasurement:
        return m if m.range_m is None else replace(m, range_m=factor * m.range_m)

    return _each(fault, scaled)


_DIRECTIONS_WRONG = _each(
    "directions of arrival are wrong", lambda m: replace(m, paths=()) if m.range_m is not None else None
)
_RANGES_WRONG = _each("ranges are wrong", lambda m: replace(m, range_m=None, range_sigma_m=None) if m.paths else None)
