"""Scan context: what a place looks like from above, whichever way the robot faces.

After Kim and Kim, "Scan Context: Egocentric Spatial Descriptor for Place Recognition within 3D Point Cloud Map", IROS
2018.  A descriptor is a polar picture `(rings, sectors)` of the greatest height in each bin.  Turning the sensor shifts
its columns, so two descriptors are compared at every shift.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import Literal, Self

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft

from wiclosure.frontends.config import ScanContextSettings
from wiclosure.types import Float32Array, FloatArray, IntArray

_MIN_SHARED_COLUMNS = 0.25
_POINTS_AT_ONCE = 1 << 14  # what the fast caches hold

# arctan(t) / (2 pi t) as a polynomial in t^2, fitted where t = sqrt(u) lies in [0, 1].
_U = (0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 200))) + 1e-9
_ARCTAN = np.polynomial.Polynomial.fit(_U, np.arctan(np.sqrt(_U)) / (2 * np.pi * np.sqrt(_U)), 4).convert().coef
_ARCTAN = _ARCTAN.astype(np.float32)

# Pairs are compared in rectangles of so many keyframes, which fit the caches; of fewer matches where descriptors are
# large: from 2^18 multiplications on, OpenBLAS shares a matrix product among threads of its own, which hold up ours.
_QUERIES_AT_ONCE, _MATCHES_AT_ONCE = 32, 64
_LARGEST_PRODUCT = (1 << 18) - 1
_MOST_THREADS = 8  # beyond, memory is what they wait for


def describe(points: FloatArray | Float32Array, settings: ScanContextSettings) -> Float32Array:
    """Scan context `(rings, sectors)` of a cloud `(N, 3)` in the body's axes (paper, eqs. 1-3); 0 marks an empty bin.

    Heights are counted from `height_offset_m` below the sensor, and what lies deeper is left out.
    """
    image = np.zeros((settings.rings + 1) * settings.sectors, np.float32)  # one ring more, for points out of range
    used_points = np.zeros(image.size)
    for start in range(0, len(points), _POINTS_AT_ONCE):
        bins, height = _bins(points[start : start + _POINTS_AT_ONCE], settings)
        np.maximum.at(image, bins, height)
        if settings.min_points_per_bin > 1:
            used_points += np.bincount(bins, weights=height > 0, minlength=image.size)
    if settings.min_points_per_bin > 1:
        image[used_points < settings.min_points_per_bin] = 0.0
    return image.reshape(-1, settings.sectors)[:-1]


def _bins(points: FloatArray | Float32Array, settings: ScanContextSettings) -> tuple[NDArray[np.int32], Float32Array]:
    """Bin and height of each point.

    Points that do not count are not left out, which would take longer: those out of range go to the ring beyond the
    last, and the heights of those too deep are negative.
    """
    x, y, z = np.array(points.T, np.float32, order="C")  # one coordinate after the other: twice as fast below
    distance, turns = np.sqrt(x * x + y * y), _turns(x, y)
    ring = np.minimum(distance * np.float32(settings.rings / settings.max_range_m), settings.rings).astype(np.int32)
    sector = np.minimum(turns * np.float32(settings.sectors), settings.sectors - 1).astype(np.int32)
    return ring * settings.sectors + sector, z + np.float32(settings.height_offset_m)


def _turns(x: Float32Array, y: Float32Array) -> Float32Array:
    """Azimuths as shares of a full turn, [0, 1], within 4e-6: arctan2 would take half of the descriptor's time.

    The polynomial is the least-squares fit to the arctangent on [0, 1]; other octants are mirrored into this one.
    """
    across, along = np.abs(x), np.abs(y)
    ratio = np.minimum(across, along) / (np.maximum(across, along) + np.float32(1e-12))
    square = ratio * ratio
    turns: Float32Array = _ARCTAN[-1] * square
    for coefficient in _ARCTAN[-2:0:-1]:
        turns += coefficient
        turns *= square
    turns += _ARCTAN[0]
    turns *= ratio
    # |c - t| is c - t where c > 0, and t where c = 0: np.where stumbles over random conditions.
    for mirror, beyond in ((0.25, along > across), (0.5, x < 0), (1.0, y < 0)):
        np.abs(np.subtract(np.float32(mirror) * beyond, turns, out=turns), out=turns)
    return turns


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
        columns: `(frequencies, K, 2 rings)` float32, real and imaginary parts, of the columns scaled to unit length.
        occupied: `(K, sectors)` float32, 1 where a column is not empty.
    """

    columns: Float32Array
    occupied: Float32Array

    @classmethod
    def of(cls, descriptors: Float32Array) -> Self:
        """Transforms of descriptors `(K, rings, sectors)`."""
        length = np.linalg.norm(descriptors, axis=1, keepdims=True)
        unit = np.divide(descriptors, length, out=np.zeros_like(descriptors), where=length > 0)
        spectrum = fft.rfft(np.asarray(unit, np.float32), axis=2).transpose(2, 0, 1)
        columns = np.concatenate([spectrum.real, spectrum.imag], axis=2)
        return cls(np.ascontiguousarray(columns, np.float32), (length[:, 0] > 0).astype(np.float32))

    def some(self, keyframes: IntArray) -> Self:
        """Those of keyframes `(n,)`."""
        return type(self)(self.columns.take(keyframes, axis=1), self.occupied[keyframes])

    @property
    def sectors(self) -> int:
        """Number of columns."""
        return int(self.occupied.shape[1])


def compare_descriptors(
    query: ColumnSpectra, match: ColumnSpectra, index_query: IntArray, index_match: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Distance `(M,)` in [0, 1] at the best shift (paper, eq. 7), and yaw `(M,)` of the match's body in the query's.

    Yaws are in (-pi, pi]: a point at azimuth phi of the match is at phi + yaw of the query.  Time follows the number of
    pairs as long as neighbouring queries are paired with much the same matches; memory is bounded.
    """
    distance, shift = np.zeros(len(index_query)), np.zeros(len(index_query), np.int64)
    order = np.argsort(index_query, kind="stable")
    first = np.flatnonzero(np.diff(index_query[order], prepend=-1))
    bands = np.split(order, first[_QUERIES_AT_ONCE::_QUERIES_AT_ONCE])

    def score(pairs: IntArray) -> None:
        """A band: all pairs of some neighbouring queries."""
        rows, row = np.unique(index_query[pairs], return_inverse=True)
        columns, column = np.unique(index_match[pairs], return_inverse=True)
        similarity, turn = _Band(query.some(rows)).best(match, columns)
        distance[pairs], shift[pairs] = 1.0 - similarity[column, row], turn[column, row]

    # NumPy leaves other threads their turn; bands do not depend on the number of threads, nor does the result.
    with ThreadPoolExecutor(min(os.cpu_count() or 1, _MOST_THREADS)) as pool:
        list(pool.map(score, bands))
    turned = shift / query.sectors
    return np.clip(distance, 0.0, 1.0), 2 * np.pi * np.where(turned > 0.5, turned - 1.0, turned)


class _Band:
    """Some queries `(R,)`, made ready to be compared with any matches."""

    def __init__(self, query: ColumnSpectra) -> None:
        self._occupied = query.occupied
        twice = np.concatenate([query.occupied, query.occupied[:, :-1]], axis=1)
        self._turned = sliding_window_view(twice, query.sectors, axis=1)  # occupied: (queries, columns, shifts)
        # A product of one spectrum with another's conjugate, in real numbers: its real part, then its imaginary part.
        re, im = np.split(np.ascontiguousarray(query.columns.transpose(0, 2, 1)), 2, axis=1)
        self._spectra = np.block([[re, im], [im, -re]])

    def best(self, match: ColumnSpectra, columns: IntArray) -> tuple[Float32Array, IntArray]:
        """Greatest similarity `(C, R)` of matches `columns` and all queries over all shifts, and that shift."""
        shape = len(columns), len(self._occupied)
        similarity, shift = np.empty(shape, np.float32), np.empty(shape, np.int64)
        at_once = min(_MATCHES_AT_ONCE, max(1, _LARGEST_PRODUCT // max(1, self._spectra[0].size)))
        for start in range(0, len(columns), at_once):
            chunk = slice(start, start + at_once)
            profiles = self._profiles(match.some(columns[chunk]))
            shift[chunk] = profiles.argmax(axis=2)
            similarity[chunk] = np.take_along_axis(profiles, shift[chunk, :, None], axis=2)[:, :, 0]
        return similarity, shift

    def _profiles(self, match: ColumnSpectra) -> Float32Array:
        """Similarity `(matches, queries, shifts)`: the mean cosine of the columns (paper, eq. 6).

        By the correlation theorem the sums over all shifts are products of spectra: one matrix product a frequency, and
        one a match back to shifts.
        """
        frequencies, matches, _ = match.columns.shape
        products = np.empty((matches, frequencies, self._spectra.shape[2]), np.float32)
        np.matmul(match.columns, self._spectra, out=products.transpose(1, 0, 2))
        spectra = products.reshape(matches, 2 * frequencies, -1).transpose(0, 2, 1)
        profiles = spectra @ _inverse_transform(match.sectors)
        profiles /= self._columns_shared(match)
        return profiles

    def _columns_shared(self, match: ColumnSpectra) -> Float32Array:
        """Over how many columns the mean runs, `(matches, queries, shifts)`.

        Over those occupied in both, so that a sensor that does not look all around can be compared, but over at least a
        quarter of all: a few alike columns are no place.  Counted are the query's, without those that face an empty one
        of the match: few columns are empty in any match.
        """
        empty = 1 - match.occupied
        some = np.flatnonzero(empty.any(axis=0))
        lost = empty[:, some] @ self._turned[:, some]
        shared = self._occupied.sum(axis=1)[:, None, None] - lost
        np.maximum(shared, np.float32(_MIN_SHARED_COLUMNS * match.sectors), out=shared)
        return np.asarray(shared.transpose(1, 0, 2))


@cache
def _inverse_transform(sectors: int) -> Float32Array:
    """`(2 frequencies, sectors)`: from a real signal's spectrum, real and imaginary parts in turn, to the signal."""
    identity = np.eye(sectors // 2 + 1)
    parts = np.stack([identity, 1j * identity], axis=1).reshape(-1, len(identity))
    return np.asarray(fft.irfft(parts, n=sectors, axis=1), np.float32)
