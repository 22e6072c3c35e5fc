"""How differently high two robots on the ground may be: by the slopes that both have seen, and the ground's roughness.

Ranges between robots on nearly level ground tell their difference in height as little as a mirror would: `z` enters
squared, and what noise adds to a range is taken for a height.  The ground tells more: where neither robot climbed over
a distance like the one between them, neither of them flies.
"""

from __future__ import annotations

import numpy as np

from wiclosure.types import FloatArray, Trajectory
from wiclosure.wiclosure_filter.config import AlignmentSettings

_LAGS = 5


def height_sigma_m(a: Trajectory, b: Trajectory, distance_m: float, settings: AlignmentSettings) -> float:
    """Standard deviation of the difference of two robots' heights, a distance apart, before the radio tells of it.

    Args:
        a: odometry, z up.
        b: that of the other.
        distance_m: between the robots.
        settings: least and largest, and the least slope.
    """
    slopes = [slope(t.positions, distance_m) for t in (a, b)]
    ground = np.hypot(settings.height_floor_m, max(*slopes, settings.height_ratio) * distance_m)
    return float(min(ground, settings.height_sigma_m))


def slope(positions: FloatArray, distance_m: float) -> float:
    """Root mean square slope of a path `(N, 3)` between places up to `distance_m` of travel apart; 0 without any."""
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(positions[:, :2], axis=0), axis=1))])
    lag = np.linspace(distance_m / _LAGS, distance_m, _LAGS)[:, None]
    there = travelled + lag <= travelled[-1]
    later = np.minimum(np.searchsorted(travelled, travelled + lag), len(positions) - 1)
    rise = np.where(there, positions[later, 2] - positions[:, 2], 0.0)
    squared = ((rise / lag) ** 2).sum(axis=1) / np.maximum(there.sum(axis=1), 1)
    return float(np.sqrt(squared.max()))
