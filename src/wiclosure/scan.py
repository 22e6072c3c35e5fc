"""One LiDAR sweep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.arrays import Float32Array, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One LiDAR sweep in the sensor's axes.

    Args:
        stamp_ns: time of the scan, as its source states it.
        points: `(N, 3)` float64, metres; finite, without returns at the origin.
        times: `(N,)` seconds after `stamp_ns` (may be negative) at which each point was measured, finite; or None.
        intensity: `(N,)`, or None.
    """

    stamp_ns: int
    points: FloatArray
    times: FloatArray | None = None
    intensity: Float32Array | None = None

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise ValueError(f"scan points have shape {self.points.shape}; expected (N, 3)")
        for name, values in (("times", self.times), ("intensity", self.intensity)):
            if values is not None and values.shape != (len(self.points),):
                raise ValueError(f"scan {name} have shape {values.shape}; expected ({len(self.points)},)")
        if self.times is not None and not np.isfinite(self.times).all():
            raise ValueError("scan times are not all finite; leave out the points that have none")
