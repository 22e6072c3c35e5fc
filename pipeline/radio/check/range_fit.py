"""The transform between two odometry frames, and the scale of the ranges, that fit ranges best.

With yaw known, squared ranges are linear in the translation, its square and the square of the scale:
`s^2 r^2 = |d|^2 - 2 d.t + |t|^2` with `d = a - R b`.  So yaws are tried around the circle, and the best few refined.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from wiclosure.types import FloatArray

_YAWS = 24
_REFINED = 5
FEWEST = 12
"""Ranges that a fit of five numbers needs to say anything."""


@dataclass(frozen=True, slots=True)
class RangeFit:
    """A fit.

    Args:
        yaw: rad, of frame b in frame a.
        translation: `(3,)` metres.
        scale: metres of one unit of the ranges.
        scale_error: its relative standard deviation by the residuals; NaN where the scale was given.
        rms_m: root of the mean square of the residuals, the worst tenth left out.
        typical_m: median of the ranges, scaled.
        count: ranges fitted.
    """

    yaw: float
    translation: FloatArray
    scale: float
    scale_error: float
    rms_m: float
    typical_m: float
    count: int

    def residuals_m(self, a: FloatArray, b: FloatArray, ranges: FloatArray) -> FloatArray:
        """`(M,)` distance by the fit, less the range."""
        return np.asarray(np.linalg.norm(a - _turned(b, self.yaw) - self.translation, axis=1) - self.scale * ranges)


def fit_ranges(a: FloatArray, b: FloatArray, ranges: FloatArray, scale: float | None = 1.0) -> RangeFit | None:
    """The best fit, or None with too few ranges.

    Args:
        a: `(M, 3)` antennas of the first robot, in its frame.
        b: `(M, 3)` antennas of the second, in its own.
        ranges: `(M,)`.
        scale: metres of one unit of the ranges; None finds it.
    """
    if len(ranges) < FEWEST:
        return None
    centre_a, centre_b = a.mean(axis=0), b.mean(axis=0)
    near_a, near_b = a - centre_a, b - centre_b
    starts = sorted((_linear(near_a, near_b, ranges, yaw, scale) for yaw in _yaws()), key=lambda start: start[0])
    fits = [_refined(near_a, near_b, ranges, start, scale) for _, start in starts[:_REFINED]]
    fits += [_refined(near_a, near_b, ranges, _raised(fit, scale), scale) for fit in fits]
    best = min(fits, key=lambda fit: fit.rms_m / max(fit.scale, 1e-9))
    translation = best.translation + centre_a - _turned(centre_b[None], best.yaw)[0]
    return replace(best, translation=translation)


def refit(a: FloatArray, b: FloatArray, ranges: FloatArray, near: RangeFit) -> RangeFit:
    """A fit in metres that starts at one of nearly the same data: quick, to follow it while a clock is moved."""
    start = np.concatenate([[near.yaw], near.translation, [0.0]])
    return _refined(a, b, ranges, start, 1.0)


def _yaws() -> FloatArray:
    return np.arange(_YAWS) * 2 * np.pi / _YAWS


def _turned(points: FloatArray, yaw: float) -> FloatArray:
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))


def _raised(fit: RangeFit, scale: float | None) -> FloatArray:
    """A start above a fit, by the height that explains its residuals: on level ground no descent leaves the level."""
    height = np.sqrt(2 * fit.typical_m * fit.rms_m)
    x, y, z = fit.translation
    return np.array([fit.yaw, x, y, z + height, np.log(fit.scale)])


def _linear(
    a: FloatArray, b: FloatArray, ranges: FloatArray, yaw: float, scale: float | None
) -> tuple[float, FloatArray]:
    """RMS in metres and `[yaw, t, log s]` by linear least squares; each row weighted to be a residual of a range."""
    d = a - _turned(b, yaw)
    columns = [-2 * d, np.ones((len(d), 1))]
    goal = -np.sum(d**2, axis=1)
    typical = max(float(np.median(ranges)), 1e-9)
    if scale is None:
        columns.append(-((ranges / typical) ** 2)[:, None])
    else:
        goal = goal + (scale * ranges) ** 2
    weight = 1 / np.maximum(2 * ranges / typical, 0.1)
    solution = np.linalg.lstsq(np.hstack(columns) * weight[:, None], goal * weight, rcond=1e-9)[0]
    found = scale if scale is not None else float(np.sqrt(max(solution[4], 1e-12))) / typical
    x, y, z, square = solution[:4]
    height = np.sqrt(max(square - x**2 - y**2, 0.0))  # on level ground only the square tells it
    translations = np.array([[x, y, z], [x, y, height], [x, y, -height]])
    rms = [_trimmed_rms(np.linalg.norm(d - t, axis=1) - found * ranges) for t in translations]
    best = int(np.argmin(rms))
    relative = rms[best] / (found * typical if scale is None else 1.0)
    return relative, np.concatenate([[yaw], translations[best], [np.log(found)]])


def _refined(a: FloatArray, b: FloatArray, ranges: FloatArray, start: FloatArray, scale: float | None) -> RangeFit:
    free = scale is None

    def residual(x: FloatArray) -> FloatArray:
        found = float(np.exp(x[4])) if scale is None else scale
        distance = np.linalg.norm(a - _turned(b, float(x[0])) - x[1:4], axis=1)
        return np.asarray(distance / found - ranges) if free else np.asarray(distance - found * ranges)

    noise = max(_trimmed_rms(residual(start)), 1e-6)
    result = least_squares(residual, start if free else start[:4], loss="soft_l1", f_scale=noise, max_nfev=60)
    found = float(np.exp(result.x[4])) if free else float(scale or 1.0)
    rms = _trimmed_rms(residual(result.x))
    error = _last_error(np.asarray(result.jac, float), rms) if free else np.nan
    rms_m = rms * found if free else rms
    return RangeFit(
        yaw=float(result.x[0]),
        translation=result.x[1:4],
        scale=found,
        scale_error=error,
        rms_m=rms_m,
        typical_m=found * float(np.median(ranges)),
        count=len(ranges),
    )


def _last_error(J: FloatArray, rms: float) -> float:
    """Standard deviation of the last number of a fit, the others free; infinite where they can stand in for it."""
    others, last = J[:, :-1], J[:, -1]
    alone = last - others @ np.linalg.lstsq(others, last, rcond=1e-9)[0]
    own = float(np.linalg.norm(alone))
    return rms / own if own > 1e-6 * max(float(np.linalg.norm(last)), 1e-12) else float("inf")


def _trimmed_rms(residual: FloatArray) -> float:
    """Without the worst tenth: ranges through walls are no matter of units."""
    ordered = np.sort(np.abs(residual))
    return float(np.sqrt(np.mean(ordered[: max(int(0.9 * len(ordered)), 1)] ** 2)))
