"""One LiDAR sweep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.arrays import Float32Array, FloatArray, float_array, stamp
from wiclosure.errors import InputError


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Scan:
    """One LiDAR sweep in the sensor's axes.

    Args:
        stamp_ns: time of the scan, as its source states it.
        points: `(N, 3)` float64, metres; finite, without returns at the origin.
        times: `(N,)` seconds after `stamp_ns` (may be negative) at which each point was measured, finite; or None.
        intensity: `(N,)` float32, or None.

    Raises:
        InputError: a stamp that is no integer, shapes that do not belong together, or a number that is not finite.
            Lists, and arrays of other numbers, are converted.
    """

    stamp_ns: int
    points: FloatArray
    times: FloatArray | None = None
    intensity: Float32Array | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", stamp(self.stamp_ns, "stamp_ns of a scan"))
        object.__setattr__(self, "points", float_array(self.points, "points of a scan"))
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise InputError(f"points of a scan have shape {self.points.shape}; expected (N, 3)")
        if self.times is not None:
            object.__setattr__(self, "times", float_array(self.times, "times of a scan"))
        if self.intensity is not None:
            object.__setattr__(self, "intensity", np.asarray(self.intensity, np.float32))
        for name, values in (("times", self.times), ("intensity", self.intensity)):
            if values is not None and values.shape != (len(self.points),):
                raise InputError(f"{name} of a scan have shape {values.shape}; expected ({len(self.points)},)")
        for name, values in (("points", self.points), ("times", self.times)):
            if values is not None and not np.isfinite(values).all():
                raise InputError(f"{name} of a scan are not all finite; leave out the points where they are not")

    def __repr__(self) -> str:
        sweep = ""
        if self.times is not None and len(self.times):
            sweep = f", sweep of {np.ptp(self.times) * 1e3:.0f} ms"
        return f"Scan({self.stamp_ns * 1e-9:.3f} s, {len(self.points)} points{sweep})"
