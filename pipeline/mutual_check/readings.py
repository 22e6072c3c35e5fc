"""Ways to read the log of two robots: with one systematic error undone, of a size that is known or is tried.

The errors are those of `wiclosure.wiclosure_filter.faults`.  There, a correction must speak for itself; here closures
tell where the robots are, so that errors of any size and parts of a log can be tried as well.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.types import WirelessLog, WirelessMeasurement
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
_SCALES = tuple(s for s in np.round(np.arange(0.84, 1.17, 0.02), 2).tolist() if s != 1.0)
_TURNS_DEG = tuple(d for d in range(-170, 180, 10) if d % 90)  # quarters are errors of their own


@dataclass(frozen=True, eq=False)
class Reading:
    """One systematic error.

    Args:
        corrections: what undoes it, for each size that is tried; exactly one of them holds.
        changes_alignment: whether the log, with it undone, may tell quite another alignment: that is searched for.
    """

    corrections: tuple[Correction, ...]
    changes_alignment: bool = False


def readings(robot_a: str, robot_b: str, log: WirelessLog) -> list[Reading]:
    """All errors that the log of two robots may have."""
    clocks = tuple(clocks_apart(robot_b, seconds) for seconds in _CLOCKS_S)
    # Wider standard deviations make neighbouring measurements count for more, which is no evidence.
    apart = {c.fault for c in (*clocks, *(sigmas_too_small(factor) for factor in (3.0, 10.0)))}
    known = [c for c in corrections(robot_a, robot_b, log) if c.fault not in apart]
    found = [Reading((correction,), correction.of_log) for correction in known]
    found.append(Reading(clocks))
    ranged, directed = (any(has(m) for m in log.measurements) for has in (_has_range, _has_paths))
    if ranged:
        found += [Reading(tuple(map(ranges_off, _BIASES_M))), Reading(tuple(map(_ranges_scaled, _SCALES)))]
    if directed:
        found.append(Reading(tuple(azimuths_off(float(np.radians(degrees))) for degrees in _TURNS_DEG)))
    if ranged and directed:
        found += [Reading((_DIRECTIONS_WRONG,), True), Reading((_RANGES_WRONG,), True)]
    return found


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


def _ranges_scaled(factor: float) -> Correction:
    side = "long" if factor < 1 else "short"

    def scaled(m: WirelessMeasurement) -> WirelessMeasurement:
        return m if m.range_m is None else replace(m, range_m=factor * m.range_m)

    return _each(f"ranges are about {abs(100 / factor - 100):.0f} % too {side} for the odometry", scaled)


_DIRECTIONS_WRONG = _each(
    "directions of arrival are wrong", lambda m: replace(m, paths=()) if m.range_m is not None else None
)
_RANGES_WRONG = _each("ranges are wrong", lambda m: replace(m, range_m=None, range_sigma_m=None) if m.paths else None)
