"""What every odometry must know of a scan before it follows it: which points count, and when they were measured."""

from __future__ import annotations

import numpy as np

from wiclosure.frontends.config import OdometrySettings
from wiclosure.types import BoolArray, Float32Array, FloatArray, IntArray, Scan

_NO_TIMES = np.zeros(0)


def within_range(points: FloatArray | Float32Array, settings: OdometrySettings) -> BoolArray:
    """Which of the points `(N, 3)` lie within the range used."""
    squared = np.einsum("ij,ij->i", points, points)
    return np.asarray((squared > settings.min_range_m**2) & (squared < settings.max_range_m**2))


def sweep_times(scan: Scan, settings: OdometrySettings) -> FloatArray:
    """Times `(N,)` to deskew by, seconds after the scan's stamp; `(0,)` where there is nothing to deskew by.

    That is where points carry no times, where these are all alike (KISS-ICP would divide by zero), and where the
    settings say so.
    """
    if scan.times is None or not settings.deskew or len(scan.times) == 0 or np.ptp(scan.times) <= 0:
        return _NO_TIMES
    return scan.times


def sweep_stamps_ns(scan: Scan, settings: OdometrySettings) -> IntArray:
    """`(2,)` the instants of the first and of the last point; the scan's own stamp twice where points carry no times.

    The pose of a scan, and its deskewed points, belong to the last.
    """
    times = sweep_times(scan, settings)
    if len(times) == 0:
        return np.array([scan.stamp_ns, scan.stamp_ns], np.int64)
    ends = (float(times.min()), float(times.max()))
    return np.array([scan.stamp_ns + round(seconds * 1e9) for seconds in ends], np.int64)
