"""Ranges held against odometry: steps that no robot can have made, units, the fit, the stated noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wiclosure.formats.radio.radio_units import METRES, LengthUnit
from wiclosure.pipeline.radio.check.finding import Finding
from wiclosure.pipeline.radio.check.geometry import PairSamples
from wiclosure.pipeline.radio.check.range_fit import FEWEST, RangeFit, fit_ranges
from wiclosure.types import FloatArray, Trajectory

_MOST = 400  # ranges of a pair that are fitted
_LEAST_TRAVEL_M = 1.0  # between two ranges that are held against each other
_TOO_LONG = 1.5  # times what the robots travelled: more than noise and drift
_NEAR = 1.25  # a factor within this of a unit's is that unit's
_SIGMAS = 4.0  # by which a scale must be off to be another unit's, where no step is too long
_SURE = 0.15  # relative standard deviation of a scale that tells units apart


@dataclass(frozen=True, slots=True, eq=False)
class RangeCheck:
    """What the ranges of a pair say, and the fit for those who go on with it."""

    findings: tuple[Finding, ...]
    fit: RangeFit | None = None


def check_ranges(
    samples: PairSamples, trajectories: Mapping[str, Trajectory], shift_ns: int = 0, unit: LengthUnit = "m"
) -> RangeCheck:
    """Units, steps, fit and noise of one pair, the stamps moved by `shift_ns`; `unit` is what the log was read in."""
    samples = samples.select(np.isfinite(samples.ranges_m) & samples.covered(trajectories, shift_ns))
    if len(samples.ranges_m) < 2:
        return RangeCheck(())
    a, b = samples.antennas(trajectories, shift_ns)
    ratio, steps = step_ratio(a, b, samples.ranges_m)
    thinned = _thinned(len(a))
    free = fit_ranges(a[thinned], b[thinned], samples.ranges_m[thinned], None)
    told = _unit_finding(samples.robots, ratio, steps, free, unit)
    if told.level == "suspect":
        return RangeCheck((told,))
    fixed = fit_ranges(a[thinned], b[thinned], samples.ranges_m[thinned])
    findings = [told]
    findings += _steps_finding(samples, a, b) + _fit_findings(samples, a, b, fixed, free)
    return RangeCheck(tuple(findings), fixed)


def step_ratio(a: FloatArray, b: FloatArray, ranges: FloatArray) -> tuple[float, int]:
    """How much longer ranges change than both robots travelled between (95 % quantile), and over how many steps.

    A range cannot change by more than both antennas moved, whatever the frames: `|r1 - r0| <= |a1 - a0| + |b1 - b0|`.
    """
    travel = np.linalg.norm(np.diff(a, axis=0), axis=1) + np.linalg.norm(np.diff(b, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(travel)])
    later = np.searchsorted(along, along + _LEAST_TRAVEL_M)
    first = np.flatnonzero(later < len(along))
    later = later[first]
    if not len(first):
        return float("nan"), 0
    chord = np.linalg.norm(a[later] - a[first], axis=1) + np.linalg.norm(b[later] - b[first], axis=1)
    moved = chord > 0.5 * _LEAST_TRAVEL_M
    ratios = np.abs(ranges[later] - ranges[first])[moved] / chord[moved]
    return (float(np.quantile(ratios, 0.95)), int(moved.sum())) if moved.any() else (float("nan"), 0)


def _unit_finding(
    pair: tuple[str, str], ratio: float, steps: int, free: RangeFit | None, read_as: LengthUnit
) -> Finding:
    """Which unit the ranges seem to have, by the fitted scale, and by steps that are too long."""
    too_long = steps >= FEWEST and ratio > _TOO_LONG
    if free is not None and free.scale_error < _SURE and free.rms_m < 0.25 * free.typical_m:
        by_fit = _unit_of(METRES[read_as] * free.scale)
        told = f"by the shape of both paths 1 {read_as} in the log is {free.scale * METRES[read_as]:.4g} m"
        told += f" (± {100 * free.scale_error:.1g} %)"
        if by_fit == read_as:
            return Finding("unit", "good", told, pair)
        if by_fit is not None and (too_long or abs(np.log(free.scale)) > _SIGMAS * free.scale_error):
            told += f", as {by_fit} are"
            told += f"; ranges change up to {ratio:.3g} times as much as both robots travelled" if too_long else ""
            return Finding("unit", "suspect", told, pair, {"unit": by_fit})
        if not too_long:
            return Finding("unit", "note", f"{told}, which no unit explains", pair)
    if too_long:
        longest_m = METRES[read_as] / ratio
        possible = [unit for unit, factor in METRES.items() if longest_m / 20 < factor <= _TOO_LONG * longest_m]
        text = (
            f"ranges change {ratio:.3g} times as much as both robots travelled (95 % of {steps} steps of"
            f" {_LEAST_TRAVEL_M:g} m stay below that); a unit of at most {longest_m:.2g} m fits"
        )
        best = max(possible, key=lambda unit: METRES[unit], default=None)
        return Finding("unit", "suspect", text, pair, {} if best is None else {"unit": best})
    if steps < FEWEST:
        return Finding("motion", "note", "the robots moved too little to tell the unit of the ranges", pair)
    return Finding("unit", "note", "no range changes faster than the robots moved; more the data do not tell", pair)


def _unit_of(length_m: float) -> LengthUnit | None:
    unit, factor = min(METRES.items(), key=lambda item: abs(np.log(item[1] / length_m)))
    return unit if abs(np.log(factor / length_m)) < np.log(_NEAR) else None


def _steps_finding(samples: PairSamples, a: FloatArray, b: FloatArray) -> list[Finding]:
    """Single jumps beyond what both robots travelled and the stated noise explain."""
    travel = np.linalg.norm(np.diff(a, axis=0), axis=1) + np.linalg.norm(np.diff(b, axis=0), axis=1)
    noise = 4 * np.hypot(samples.sigmas_m[1:], samples.sigmas_m[:-1])
    excess = np.abs(np.diff(samples.ranges_m)) - 1.1 * travel - noise
    jumps = int((excess > 0).sum())
    if not jumps:
        return []
    text = (
        f"{jumps} of {len(excess)} ranges change by more than both robots' way and four times the stated noise"
        f" (worst {excess.max():.2g} m more): reflections, or sigma is stated too small"
    )
    return [Finding("steps", "suspect" if jumps > 0.2 * len(excess) else "note", text, samples.robots)]


def _fit_findings(
    samples: PairSamples, a: FloatArray, b: FloatArray, fixed: RangeFit | None, free: RangeFit | None
) -> list[Finding]:
    if fixed is None:
        return []
    residual = fixed.residuals_m(a, b, samples.ranges_m)
    spread = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
    stated = float(np.median(samples.sigmas_m))
    text = f"{fixed.count} ranges fit the paths to {fixed.rms_m:.2g} m (stated sigma {stated:.2g} m)"
    shape_m = float(np.std(samples.ranges_m))
    if fixed.rms_m > 5 * stated + 0.1 * shape_m:
        text += "; no placement of the two paths agrees with them: wrong robots, a wrong clock, or much drift"
        return [Finding("fit", "suspect", text, samples.robots)]
    if fixed.rms_m > 5 * stated:
        text += "; more than the noise: reflections, or drift of the odometry"
        return [Finding("fit", "note", text, samples.robots)]
    found = [Finding("fit", "good", text, samples.robots)]
    if not stated / 3 < spread < stated * 3 and len(residual) >= 3 * FEWEST:
        advice = float(f"{max(spread, 0.01):.1g}")
        text = f"residuals spread by {spread:.2g} m, the log states {stated:.2g} m"
        found.append(Finding("noise", "note", text, samples.robots, {"range_sigma": advice}))
    return found


def _thinned(count: int) -> FloatArray:
    return np.unique(np.linspace(0, count - 1, min(count, _MOST)).round().astype(np.int64))
