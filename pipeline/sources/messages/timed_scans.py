"""Scans from returns and their recorded times: the one way by which all formats make them."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wiclosure.errors import InputError
from wiclosure.formats.plausible import few
from wiclosure.pipeline.sources.messages.point_times import PointClock, strays
from wiclosure.types import Float32Array, FloatArray, Scan

logger = logging.getLogger(__name__)

FARTHEST_M = 1e6
"""No LiDAR sees so far: larger numbers are damaged, or no metres."""
_LARGEST_TIME = 2.0**62  # in whatever unit; differences of two still fit 64 bits


class TimedScans:
    """Makes the scans of one recording.

    Args:
        place: what is read, for the log.
        period_s: seconds from scan to scan, where they are known.
        ns_per_unit: nanoseconds per unit of the recorded times, where they are known.
    """

    def __init__(self, place: str = "", period_s: float | None = None, ns_per_unit: int | None = None) -> None:
        self._place = place or "point clouds"
        self._clock = PointClock(place, period_s, ns_per_unit)
        self._is_far_said = False

    def __call__(
        self,
        stamp_ns: int,
        points: FloatArray,
        raw_times: NDArray[Any] | None,
        intensity: NDArray[Any] | None = None,
        *,
        are_near: bool = False,
    ) -> Scan:
        """A scan of returns `(N, 3)` with their recorded times `(N,)`, as recorded.

        Points that are too far, or whose time is no number or a stray, are left out.

        Args:
            stamp_ns: of the scan.
            points: metres.
            raw_times: in any unit.
            intensity: `(N,)`.
            are_near: no point is too far; this need not be looked at.

        Raises:
            InputError: more than a few points are too far.
        """
        keep = None if are_near else self._near(points)
        if raw_times is not None and (timed := _timed(raw_times)) is not None:
            if not timed.any():
                raw_times = None
            else:
                keep = timed if keep is None else keep & timed
        if keep is not None:
            points, raw_times, intensity = points[keep], _of(raw_times, keep), _of(intensity, keep)
        if raw_times is not None and (stray := strays(raw_times)) is not None:
            points, raw_times, intensity = points[~stray], raw_times[~stray], _of(intensity, ~stray)
        times = None if raw_times is None else self._clock.seconds_after(stamp_ns, raw_times)
        return Scan(stamp_ns, points, times, None if intensity is None else _float32(intensity))

    def _near(self, points: FloatArray) -> NDArray[np.bool_] | None:
        """Which points `(N,)` are near enough; None: all."""
        if not len(points) or (points.max() < FARTHEST_M and points.min() > -FARTHEST_M):
            return None
        near = np.asarray((np.abs(points) < FARTHEST_M).all(axis=1))
        far = int(np.count_nonzero(~near))
        what = f"{far} of {len(points)} points of a scan lie beyond {FARTHEST_M / 1000:g} km"
        if not few(far, len(points)):
            raise InputError(
                f"{what}: it is damaged, or holds coordinates of a map; scans must be in the sensor's own"
                " axes, in metres"
            )
        if not self._is_far_said:
            logger.warning("%s: %s; such points are left out, here and in other scans", self._place, what)
            self._is_far_said = True
        return near


def _timed(raw_times: NDArray[Any]) -> NDArray[np.bool_] | None:
    """Which of the recorded times `(N,)` are numbers that can be reckoned with; None: all."""
    if not len(raw_times) or (raw_times.dtype.kind in "iu" and raw_times.dtype.itemsize < 8):
        return None
    if raw_times.min() > -_LARGEST_TIME and raw_times.max() < _LARGEST_TIME:  # both are false for NaN
        return None
    if raw_times.dtype.kind == "i":
        return np.asarray((raw_times < _LARGEST_TIME) & (raw_times > -_LARGEST_TIME))
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(raw_times) < _LARGEST_TIME)  # false for NaN


def _of(values: NDArray[Any] | None, keep: NDArray[np.bool_]) -> NDArray[Any] | None:
    return None if values is None else values[keep]


def _float32(intensity: NDArray[Any]) -> Float32Array:
    with np.errstate(over="ignore", invalid="ignore"):
        return intensity.astype(np.float32, copy=False)
