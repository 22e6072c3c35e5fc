"""The paths of many measurements as arrays of one width."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure.types import BoolArray, FloatArray, IntArray, WirelessMeasurement


@dataclass(frozen=True, eq=False)
class PaddedPaths:
    """Paths of M measurements `(M, K)`, the strongest first; padded as `Links` has them.

    Args:
        azimuth, elevation, sigma: rad.
        weight: sums to 1 over the paths of a measurement.
        index: into the measurement's paths; -1 where there is no such path.
    """

    azimuth: FloatArray
    elevation: FloatArray
    sigma: FloatArray
    weight: FloatArray
    index: IntArray

    @classmethod
    def strongest(cls, chosen: Sequence[WirelessMeasurement], directed: BoolArray, max_paths: int) -> PaddedPaths:
        """The strongest paths of each measurement.

        Args:
            chosen: M measurements.
            directed: `(M,)` false where the axes of the angles are not known: such a measurement keeps no path.
            max_paths: of one measurement.
        """
        count = [len(m.paths) if ok else 0 for m, ok in zip(chosen, directed, strict=True)]
        shape = (len(chosen), max(1, min(max(count, default=0), max_paths)))
        paths = cls(np.zeros(shape), np.full(shape, np.nan), np.ones(shape), np.zeros(shape), np.full(shape, -1))
        for row, measurement in enumerate(chosen):
            strongest = sorted(range(count[row]), key=lambda k: -measurement.paths[k].weight)[:max_paths]
            for column, k in enumerate(strongest):
                path = measurement.paths[k]
                paths.azimuth[row, column], paths.sigma[row, column] = path.azimuth, path.sigma
                paths.weight[row, column], paths.index[row, column] = path.weight, k
                if path.elevation is not None:
                    paths.elevation[row, column] = path.elevation
        there = paths.index >= 0
        total = paths.weight.sum(axis=1, keepdims=True)
        equal = there / np.maximum(there.sum(axis=1, keepdims=True), 1)
        paths.weight[:] = np.where(total > 0, paths.weight / np.where(total > 0, total, 1.0), equal)
        return paths
