"""Scan context: what a place looks like from above, whichever way the robot faces.

After Kim and Kim, "Scan Context: Egocentric Spatial Descriptor for Place Recognition within 3D Point Cloud Map", IROS
2018.  A descriptor is a polar picture `(rings, sectors)` of the greatest height in each bin.  Turning the sensor shifts
its columns, so two descriptors are compared at every shift.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from wiclosure.frontends.config import ScanContextSettings
from wiclosure.types import Float32Array, FloatArray, IntArray

_PAIRS_AT_ONCE = 2048
_MIN_SHARED_COLUMNS = 0.25


def describe(points: FloatArray | Float32Array, settings: ScanContextSettings) -> Float32Array:
    """Scan context `(rings, sectors)` of a cloud `(N, 3)` in the body's axes (paper, eqs. 1-3); 0 marks an empty bin.

    Heights are counted from `height_offset_m` below the sensor, and what lies deeper is left out.
    """
    x, y, z = np.array(points.T, np.float32, order="C")  # one coordinate after the other: twice as fast below
    distance = np.sqrt(x * x + y * y)
    height = z + np.float32(settings.height_offset_m)
    used = (distance < settings.max_range_m) & (height > 0)
    ring = (distance[used] * np.float32(settings.rings / settings.max_range_m)).astype(np.intp)
    # Azimuths in (-pi, pi]: the floor of a negative share wraps around to the last sectors.
    share = np.arctan2(y[used], x[used]) * np.float32(settings.sectors / (2 * np.pi))
    sector = np.floor(share).astype(np.intp) % settings.sectors
    # Rounding may push a point just inside the range onto the ring beyond the last.
    bins = np.minimum(ring, settings.rings - 1) * settings.sectors + sector
    image = np.zeros(settings.rings * settings.sectors, np.float32)
    np.maximum.at(image, bins, height[used])
    if settings.min_points_per_bin > 1:
        image[np.bincount(bins, minlength=image.size) < settings.min_points_per_bin] = 0.0
    return image.reshape(settings.rings, settings.sectors)


def ring_keys(descriptors: Float32Array, kind: Literal["mean-height", "occupied-share"]) -> Float32Array:
    """What of descriptors `(K, rings, sectors)` a rotation leaves as it is: `(K, rings)`.

    `occupied-share` is the paper's (eq. 7); `mean-height` also tells a hedge from a house.
    """
    rows = descriptors > 0 if kind == "occupied-share" else descriptors
    return np.asarray(rows.mean(axis=2), np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class ColumnSpectra:
    """Descriptors made ready to be compared at all column shifts: Fourier transforms along the sectors.

    Args:
        columns: `(K, rings, frequencies)` complex64, of the columns scaled to unit length.
        occupied: `(K, frequencies)` complex64, of the mask of columns that are not empty.
        sectors: number of columns.
    """

    columns: NDArray[np.complex64]
    occupied: NDArray[np.complex64]
    sectors: int

    @classmethod
    def of(cls, descriptors: Float32Array) -> Self:
        """Transforms of descriptors `(K, rings, sectors)`."""
        length = np.linalg.norm(descriptors, axis=1, keepdims=True)
        unit = np.divide(descriptors, length, out=np.zeros_like(descriptors), where=length > 0)
        return cls(
            np.asarray(fft.rfft(unit, axis=2), np.complex64),
            np.asarray(fft.rfft((length[:, 0] > 0).astype(np.float32), axis=1), np.complex64),
            descriptors.shape[2],
        )


def distance_profiles(
    query: ColumnSpectra, match: ColumnSpectra, index_query: IntArray, index_match: IntArray
) -> Float32Array:
    """Distance of each pair at each column shift, `(M, sectors)` (paper, eq. 6).

    One minus the mean cosine of the columns.  By the correlation theorem the sums over all shifts are one product of
    spectra.  The mean runs over columns occupied in both, so that a sensor that does not look all around can be
    compared, but over at least a quarter of them: a few alike columns are no place.
    """
    cosines = np.einsum("mrf,mrf->mf", query.columns[index_query], match.columns[index_match].conj())
    shared = query.occupied[index_query] * match.occupied[index_match].conj()
    cosines, shared = (fft.irfft(spectrum, n=query.sectors, axis=1) for spectrum in (cosines, shared))
    return np.asarray(1.0 - cosines / np.maximum(shared, _MIN_SHARED_COLUMNS * query.sectors), np.float32)


def compare(
    query: ColumnSpectra, match: ColumnSpectra, index_query: IntArray, index_match: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Distance `(M,)` in [0, 1] at the best shift (paper, eq. 7), and yaw `(M,)` of the match's body in the query's.

    Yaws are in (-pi, pi]: a point at azimuth phi of the match is at phi + yaw of the query.  Memory is bounded whatever
    the number of pairs.
    """
    distance, shift = np.zeros(len(index_query)), np.zeros(len(index_query), np.int64)
    for start in range(0, len(index_query), _PAIRS_AT_ONCE):
        chunk = slice(start, start + _PAIRS_AT_ONCE)
        profile = distance_profiles(query, match, index_query[chunk], index_match[chunk])
        shift[chunk] = profile.argmin(axis=1)
        distance[chunk] = profile.min(axis=1)
    turn = shift / query.sectors
    return np.clip(distance, 0.0, 1.0), 2 * np.pi * np.where(turn > 0.5, turn - 1.0, turn)
