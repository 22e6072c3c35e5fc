"""Ranges held against odometry: steps that no robot can have made, units, the fit, the stated noise."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wiclosure.formats.radio_units import METRES, LengthUnit
from wiclosure.pipeline.radio.check.finding import Finding
from wiclosure.pipeline.radio.check.geometry import PairSamples
from wiclosure.pipeline.radio.check.range_fit import FEWEST, RangeFit, fit_ranges
from wiclosure.types import FloatArray, Trajectory

_MOST = 400  # ranges of a pair that are fitted
_LEAST_TRAVEL_M = 1.0  # between two ranges that are held against each other
_TOO_LONG = 1.5  # times what the robots travelled: more than noise and drift
_NEAR = 1.25  # a factor within this of a unit's is that unit's
_SURE = 0.15  # relative standard deviation of a scale that tells units apart


@dataclass(frozen=True, slots=True, eq=False)
class RangeCheck:
    """What the ranges of a pair say, and the fit for those who go on with it."""

    findings: tuple[Finding, ...]
    fit: RangeFit | None = None


def check_ranges(samples: PairSamples, trajectories: Mapping[str, Trajectory], shift_ns: int = 0) -> RangeCheck:
    """Units, steps, fit and noise of one pair, the stamps moved by `shift_ns`."""
    samples = samples.select(np.isfinite(samples.ranges_m) & samples.covered(trajectories, shift_ns))
    if len(samples.ranges_m) < 2:
        return RangeCheck(())
    a, b = samples.antennas(trajectories, shift_ns)
    ratio, steps = step_ratio(a, b, samples.ranges_m)
    thinned = _thinned(len(a))
    free = fit_ranges(a[thinned], b[thinned], samples.ranges_m[thinned], None)
    unit = _unit_finding(samples.robots, ratio, steps, free)
    if unit is not None and unit.level == "suspect":
        return RangeCheck((unit,))
    fixed = fit_ranges(a[thinned], b[thinned], samples.ranges_m[thinned])
    findings = [] if unit is None else [unit]
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


def _unit_finding(pair: tuple[str, str], ratio: float, steps: int, free: RangeFit | None) -> Finding | None:
    """Which unit the ranges seem to have, by the fitted scale, and by steps that are too long."""
    told = free is not None and free.scale_error < _SURE and free.rms_m < 0.25 * free.scale * _typical(free)
    by_fit: LengthUnit | None = None
    if told and free is not None:
        unit, factor = min(METRES.items(), key=lambda item: abs(np.log(item[1] / free.scale)))
        by_fit = unit if abs(np.log(factor / free.scale)) < np.log(_NEAR) else None
    too_long = steps >= FEWEST and ratio > _TOO_LONG
    if by_fit not in {None, "m"} and free is not None and (too_long or free.scale_error < _SURE / 3):
        text = (
            f"one unit of the ranges is {free.scale:.4g} m by the shape of both paths"
            f" (± {100 * free.scale_error:.1g} %), as {by_fit} are"
        )
        text += f"; they change up to {ratio:.3g} times as much as both robots travelled" if too_long else ""
        return Finding("unit", "suspect", text, pair, {"unit": by_fit})
    if too_long:
        possible = [unit for unit, factor in METRES.items() if factor * ratio <= _TOO_LONG]
        best = max(possible, key=lambda unit: METRES[unit])
        text = (
            f"ranges change {ratio:.3g} times as much as both robots travelled (95 % of {steps} steps of"
            f" {_LEAST_TRAVEL_M:g} m are below that); a unit of at most {1 / ratio:.2g} m fits"
        )
        known = {"unit": best} if METRES[best] * ratio > 0.05 else {}
        return Finding("unit", "suspect", text, pair, known)
    if told and free is not None and by_fit == "m":
        text = f"metres: one unit is {free.scale:.3f} m by the shape of both paths (± {100 * free.scale_error:.1g} %)"
        return Finding("unit", "good", text, pair)
    if steps < FEWEST:
        return Finding("motion", "note", "the robots moved too little to tell the unit of the ranges", pair)
    return Finding("unit", "note", "no range changes faster than the robots moved; more is not told by the data", pair)


def _typical(fit: RangeFit) -> float:
    return max(float(np.linalg.norm(fit.translation)) / max(fit.scale, 1e-9), 1.0)


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
    if fixed.rms_m > max(5 * stated, 0.2 * float(np.std(samples.ranges_m)) + 3 * stated):
        text += "; no placement of the two paths agrees with them: wrong robots, a wrong clock, or much drift"
        return [Finding("fit", "suspect", text, samples.robots)]
    found = [Finding("fit", "good", text, samples.robots)]
    if not stated / 3 < spread < stated * 3 and len(residual) >= 3 * FEWEST:
        advice = float(f"{max(spread, 0.01):.1g}")
        text = f"residuals spread by {spread:.2g} m, the log states {stated:.2g} m"
        found.append(Finding("noise", "note", text, samples.robots, {"range_sigma": advice}))
    return found


def _thinned(count: int) -> FloatArray:
    return np.unique(np.linspace(0, count - 1, min(count, _MOST)).round().astype(np.int64))
