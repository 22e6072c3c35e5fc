"""Ways to read a wireless log: as it claims to be, or with one systematic error undone.

Each error that is known from practice is one reading: what the user would have to be told, and the corrections of which
one undoes it.  An error with an unknown size has one correction for each size that is tried.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final, TypeAlias

import numpy as np

from wiclosure.types import AoaFrame, AoaPath, WirelessLog, WirelessMeasurement

Correction: TypeAlias = Callable[[WirelessLog], WirelessLog]

FEET_PER_M = 3.28084
YARDS_PER_M = 1.09361


@dataclass(frozen=True)
class Reading:
    """One systematic error of a log.

    Args:
        kind: in a word or two, as in `clock` or `units of ranges`.
        causes: one sentence part for each correction: what is wrong if it holds.
        corrections: what undoes the error; exactly one holds.
    """

    kind: str
    causes: tuple[str, ...]
    corrections: tuple[Correction, ...]


def _measurements(change: Callable[[WirelessMeasurement], WirelessMeasurement | None]) -> Correction:
    """Measurements corrected one by one; None leaves one out."""

    def corrected(log: WirelessLog) -> WirelessLog:
        changed = (change(m) for m in log.measurements)
        return replace(log, measurements=tuple(m for m in changed if m is not None))

    return corrected


def _ranges(factor: float, offset_m: float = 0.0, *, sigma_factor: float | None = None) -> Correction:
    """The sigmas are in the same unit unless another factor is given."""
    of_sigma = factor if sigma_factor is None else sigma_factor

    def change(m: WirelessMeasurement) -> WirelessMeasurement:
        if m.range_m is None or m.range_sigma_m is None:
            return m
        return replace(m, range_m=max(factor * m.range_m + offset_m, 0.0), range_sigma_m=of_sigma * m.range_sigma_m)

    return _measurements(change)


def _azimuths(sign: int, offset_deg: float) -> Correction:
    def turned(path: AoaPath) -> AoaPath:
        azimuth = np.remainder(sign * path.azimuth + np.radians(offset_deg) + np.pi, 2 * np.pi) - np.pi
        return replace(path, azimuth=float(azimuth))

    return _measurements(lambda m: replace(m, paths=tuple(map(turned, m.paths))))


def _axes(frame: AoaFrame) -> Correction:
    return _measurements(lambda m: replace(m, aoa_frame=frame) if m.paths else m)


def _clock(seconds: float) -> Correction:
    """The robot that is last by name has a clock so much ahead: where it was is looked up so much earlier."""
    late_ns = round(seconds * 1e9)

    def change(m: WirelessMeasurement) -> WirelessMeasurement:
        sent_ns = m.stamp_ns if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns
        if m.receiver < m.transmitter:
            return replace(m, transmitter_stamp_ns=sent_ns + late_ns)
        return replace(m, stamp_ns=m.stamp_ns + late_ns, transmitter_stamp_ns=sent_ns)

    return _measurements(change)


def _swapped(m: WirelessMeasurement) -> WirelessMeasurement:
    return replace(m, receiver=m.transmitter, transmitter=m.receiver) if m.paths else m


def _ranged(m: WirelessMeasurement) -> WirelessMeasurement | None:
    return None if m.range_m is None else replace(m, paths=())


def _directed(m: WirelessMeasurement) -> WirelessMeasurement | None:
    return replace(m, range_m=None, range_sigma_m=None) if m.paths else None


def _steps(first: float, last: float, step: float, *, without: float) -> tuple[float, ...]:
    values = np.round(np.arange(first, last + step / 2, step), 6)
    return tuple(float(v) for v in values if abs(v - without) > step / 2)


_UNITS = {"feet": FEET_PER_M, "yards": YARDS_PER_M, "centimetres": 100.0, "millimetres": 1000.0}
_QUARTERS = {0: "x forward", 90: "y left", 180: "x backward", -90: "y right"}
_TURNS = tuple(t for t in _steps(-170.0, 180.0, 10.0, without=0.0) if t % 90)
_SCALES = _steps(0.85, 1.15, 0.02, without=1.0)
_OFFSETS = _steps(-5.0, 5.0, 0.5, without=0.0)
_CLOCKS = _steps(-4.0, 4.0, 0.25, without=0.0)
_FRAMES: tuple[AoaFrame, ...] = ("body", "odometry", "world")

AS_CLAIMED: Final = Reading("nothing", ("the log is as it claims to be",), (lambda log: log,))

FAULTS: Final[tuple[Reading, ...]] = (
    Reading(
        "units of ranges",
        tuple(f"its ranges are in {unit}" for unit in (*_UNITS, "feet, their sigmas in metres")),
        (*(_ranges(1.0 / per_m) for per_m in _UNITS.values()), _ranges(1.0 / FEET_PER_M, sigma_factor=1.0)),
    ),
    Reading(
        "scale of ranges",
        tuple(
            f"its ranges are about {abs(100 / s - 100):.0f} % too {'long' if s < 1 else 'short'} for the odometry"
            for s in _SCALES
        ),
        tuple(_ranges(s) for s in _SCALES),
    ),
    Reading(
        "bias of ranges",
        tuple(f"its ranges are about {abs(m):g} m too {'long' if m < 0 else 'short'}" for m in _OFFSETS),
        tuple(_ranges(1.0, m) for m in _OFFSETS),
    ),
    Reading(
        "clock",
        tuple(f"the robots' clocks are about {abs(s):g} s apart" for s in _CLOCKS),
        tuple(_clock(s) for s in _CLOCKS),
    ),
    Reading(
        "handedness of azimuths",
        tuple(f"its azimuths run clockwise, from {axis}" for axis in _QUARTERS.values()),
        tuple(_azimuths(-1, turn) for turn in _QUARTERS),
    ),
    Reading(
        "zero of azimuths",
        tuple(f"its azimuths are counted from {axis}" for turn, axis in _QUARTERS.items() if turn),
        tuple(_azimuths(1, turn) for turn in _QUARTERS if turn),
    ),
    Reading(
        "mounting of the antennas",
        tuple(f"its azimuths are turned by about {-turn:g} degrees" for turn in _TURNS),
        tuple(_azimuths(1, turn) for turn in _TURNS),
    ),
    Reading(
        "axes of azimuths",
        tuple(f"its azimuths are in {frame} axes, whatever aoa_frame says" for frame in _FRAMES),
        tuple(_axes(frame) for frame in _FRAMES),
    ),
    Reading("ids", ("receiver and transmitter are swapped",), (_measurements(_swapped),)),
    Reading("compass", ("a compass is wrong",), (lambda log: replace(log, headings=()),)),
    Reading("directions", ("its directions of arrival are wrong",), (_measurements(_ranged),)),
    Reading("ranges", ("its ranges are wrong",), (_measurements(_directed),)),
)

OTHERWISE_READ: Final = tuple(r for r in FAULTS if len(r.corrections) <= 5 and r.kind != "compass")
"""Errors of few corrections: an alignment of the log's own is searched for each."""
