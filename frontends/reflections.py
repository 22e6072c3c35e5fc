"""How brightly the points of keyframes reflect: thinning keeps places only, so they are looked up among the returns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from wiclosure import se3
from wiclosure.types import Float32Array, FloatArray

RETURNS = 20_000
"""Of a scan, among which points are looked up; a scan of 128 beams then has one a degree or two."""

_LARGEST = float(np.finfo(np.float16).max)


@dataclass(frozen=True, slots=True, eq=False)
class Reflections:
    """Some returns of a scan.

    Args:
        points: `(M, 3)` m, in the axes of the cloud that they are asked about.
        intensity: `(M,)` in the sensor's own unit, finite.
    """

    points: FloatArray
    intensity: Float32Array

    @classmethod
    def of(cls, points: FloatArray | Float32Array, intensity: Float32Array, most: int = RETURNS) -> Self:
        """Every so many of the returns `(N, 3)` with their intensity `(N,)`, at most some `most`."""
        every = max(1, len(points) // most)
        points, intensity = points[::every], intensity[::every]
        finite = np.isfinite(intensity)
        return cls(np.asarray(points[finite], np.float64), np.clip(intensity[finite], -_LARGEST, _LARGEST))

    @classmethod
    def together(cls, scans: Sequence[tuple[FloatArray, Self]]) -> Self:
        """Those of several scans: each one's `T_here_scan (4, 4)`, and its own."""
        points = [se3.transform(T_here_scan, of.points) for T_here_scan, of in scans]
        return cls(np.concatenate(points), np.concatenate([of.intensity for _, of in scans]))

    def at(self, cloud: Float32Array) -> NDArray[np.float16]:
        """Intensity `(K,)` of the points `(K, 3)`: that of the nearest return; NaN where there is none."""
        if len(self.points) == 0:
            return np.full(len(cloud), np.nan, np.float16)
        # Unbalanced, a tree is built in half the time, and searched as fast.
        tree = cKDTree(self.points, balanced_tree=False, compact_nodes=False)
        return np.asarray(self.intensity[tree.query(cloud)[1]], np.float16)
