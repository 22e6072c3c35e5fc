"""Scan context: what a place looks like from above, whichever way the robot faces.

After Kim and Kim, "Scan Context: Egocentric Spatial Descriptor for Place Recognition within 3D Point Cloud Map", IROS
2018.  A descriptor is a polar picture `(rings, sectors)` of the greatest height in each bin.  Turning the sensor shifts
its columns, so two descriptors are compared at every shift.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal, Self

import numpy as np
from scipy import fft

from wiclosure.frontends.config import ScanContextSettings
from wiclosure.types import Float32Array, FloatArray, IntArray

_MIN_SHARED_COLUMNS = 0.25
_POINTS_AT_ONCE = 1 << 14  # what the fast caches hold

# arctan(t) / (2 pi t) as a polynomial in t^2, fitted where t = sqrt(u) lies in [0, 1].
_U = (0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 200))) + 1e-9
_ARCTAN = np.polynomial.Polynomial.fit(_U, np.arctan(np.sqrt(_U)) / (2 * np.pi * np.sqrt(_U)), 4).convert().coef
_ARCTAN = _ARCTAN.astype(np.float32)

# Pairs are compared in rectangles of so many keyframes: large enough for matrix products, small enough for caches.
_QUERIES_AT_ONCE, _MATCHES_AT_ONCE = 32, 250
_MOST_THREADS = 8  # beyond, memory is what they wait for


def describe(points: FloatArray | Float32Array, settings: ScanContextSettings) -> Float32Array:
    """Scan context `(rings, sectors)` of a cloud `(N, 3)` in the body's axes (paper, eqs. 1-3); 0 marks an empty bin.

    Heights are counted from `height_offset_m` below the sensor, and what lies deeper is left out.
    """
    image = np.zeros(settings.rings * settings.sectors, np.float32)
    used_points = np.zeros(image.size)
    for start in range(0, len(points), _POINTS_AT_ONCE):
        bins, height = _bins(points[start : start + _POINTS_AT_ONCE], settings)
        np.maximum.at(image, bins, height)
        if settings.min_points_per_bin > 1:
            used_points += np.bincount(bins, weights=height > 0, minlength=image.size)
    if settings.min_points_per_bin > 1:
        image[used_points < settings.min_points_per_bin] = 0.0
    return image.reshape(settings.rings, settings.sectors)


def _bins(points: FloatArray | Float32Array, settings: ScanContextSettings) -> tuple[IntArray, Float32Array]:
    """Bin and height of each point; points that do not count have height 0, which is quicker than leaving them out."""
    x, y, z = np.array(points.T, np.float32, order="C")  # one coordinate after the other: twice as fast below
    distance = np.sqrt(x * x + y * y)
    height = np.maximum(z + np.float32(settings.height_offset_m), 0) * (distance < settings.max_range_m)
    ring = (distance * np.float32(settings.rings / settings.max_range_m)).astype(np.int32)
    sector = (_turns(x, y) * np.float32(settings.sectors)).astype(np.int32)
    # Points out of range, and those that rounding pushed just beyond a limit, go to the last bin.
    np.minimum(ring, settings.rings - 1, out=ring)
    np.minimum(sector, settings.sectors - 1, out=sector)
    return (ring * settings.sectors + sector).astype(np.int64), height


def _turns(x: Float32Array, y: Float32Array) -> Float32Array:
    """Azimuths as shares of a full turn, [0, 1], within 4e-6: arctan2 would take half of the descriptor's time.

    The polynomial is the least-squares fit to the arctangent on [0, 1]; other octants are mirrored into this one.
    """
    across, along = np.abs(x), np.abs(y)
    ratio = np.minimum(across, along) / np.maximum(np.maximum(across, along), np.float32(1e-12))
    square = ratio * ratio
    turns = np.full_like(ratio, _ARCTAN[-1])
    for coefficient in _ARCTAN[-2::-1]:
        turns *= square
        turns += coefficient
    turns *= ratio
    # |c - t| is c - t where c > 0, and t where c = 0: np.where stumbles over random conditions.
    turns = np.abs(np.float32(0.25) * (along > across) - turns)
    turns = np.abs(np.float32(0.5) * (x < 0) - turns)
    return np.abs((y < 0) - turns)


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
        return cls(np.asarray(columns, np.float32), (length[:, 0] > 0).astype(np.float32))

    @property
    def sectors(self) -> int:
        """Number of columns."""
        return int(self.occupied.shape[1])


def compare(
    query: ColumnSpectra, match: ColumnSpectra, index_query: IntArray, index_match: IntArray
) -> tuple[FloatArray, FloatArray]:
    """Distance `(M,)` in [0, 1] at the best shift (paper, eq. 7), and yaw `(M,)` of the match's body in the query's.

    Yaws are in (-pi, pi]: a point at azimuth phi of the match is at phi + yaw of the query.  Time follows the number of
    pairs as long as neighbouring queries are paired with much the same matches; memory is bounded.
    """
    distance, shift = np.zeros(len(index_query)), np.zeros(len(index_query), np.int64)
    order = np.argsort(index_query, kind="stable")
    _, first = np.unique(index_query[order], return_index=True)
    bands = np.split(order, first[_QUERIES_AT_ONCE::_QUERIES_AT_ONCE])

    def score(share: Sequence[IntArray]) -> None:
        """Some of the bands: pairs of neighbouring queries."""
        comparison = _Comparison(query, match)
        for pairs in share:
            rows, columns = np.unique(index_query[pairs]), np.unique(index_match[pairs])
            row, column = np.searchsorted(rows, index_query[pairs]), np.searchsorted(columns, index_match[pairs])
            for start in range(0, len(columns), _MATCHES_AT_ONCE):
                similarity, turn = comparison.best(rows, columns[start : start + _MATCHES_AT_ONCE])
                inside = (column >= start) & (column < start + _MATCHES_AT_ONCE)
                cell = row[inside], column[inside] - start
                distance[pairs[inside]], shift[pairs[inside]] = 1.0 - similarity[cell], turn[cell]

    # NumPy leaves other threads their turn; each pair is scored alone, so that the result is the same for any number.
    threads = min(os.cpu_count() or 1, _MOST_THREADS, len(bands))
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(score, (bands[k::threads] for k in range(threads))))
    turned = shift / query.sectors
    return np.clip(distance, 0.0, 1.0), 2 * np.pi * np.where(turned > 0.5, turned - 1.0, turned)


class _Comparison:
    """Similarities of rectangles of pairs, in working memory that is used again and again."""

    def __init__(self, query: ColumnSpectra, match: ColumnSpectra) -> None:
        self._query, self._match = query, match
        # A product of one spectrum with another's conjugate, in real numbers: its real part, then its imaginary part.
        re, im = np.split(query.columns, 2, axis=2)
        self._queries = np.stack([query.columns, np.concatenate([im, -re], axis=2)])
        self._matches = np.ascontiguousarray(match.columns.transpose(0, 2, 1))
        self._shifts = query.sectors
        self._waves = _inverse_transform(self._shifts)
        # Rows of a length that is no power of two do not fight for the same lines of the cache.
        pairs = _QUERIES_AT_ONCE * _MATCHES_AT_ONCE + 16
        self._spectra = np.empty((self._waves.shape[1], pairs), np.float32)
        self._profiles, self._shared = (np.empty((self._shifts, pairs), np.float32) for _ in range(2))

    def best(self, rows: IntArray, columns: IntArray) -> tuple[Float32Array, IntArray]:
        """Greatest similarity `(R, C)` of queries `rows` and matches `columns` over all shifts, and that shift.

        The similarity at a shift (paper, eq. 6) is the mean cosine of the columns.  By the correlation theorem the sums
        over all shifts are products of spectra: one matrix product a frequency, and one back to shifts.  The mean runs
        over columns occupied in both, so that a sensor that does not look all around can be compared, but over at least
        a quarter of them: a few alike columns are no place.
        """
        shape, pairs = (len(rows), len(columns)), len(rows) * len(columns)
        spectra, profiles = self._spectra[:, :pairs], self._profiles[:, :pairs]
        products = spectra.reshape(2, len(self._matches), *shape)
        np.matmul(self._queries[:, :, rows], self._matches[:, :, columns], out=products)
        np.matmul(self._waves, spectra, out=profiles)
        profiles /= self._columns_shared(rows, columns)
        shift = profiles.argmax(axis=0)
        return profiles[shift, np.arange(pairs)].reshape(shape), shift.reshape(shape)

    def _columns_shared(self, rows: IntArray, columns: IntArray) -> Float32Array:
        """Over how many columns the mean runs, `(shifts or 1, R * C)`."""
        query, match = self._query.occupied[rows], self._match.occupied[columns]
        least = np.float32(_MIN_SHARED_COLUMNS * self._shifts)
        if query.all() or match.all():  # as with most sensors that look all around: the same at every shift
            fewer = np.minimum.outer(query.sum(axis=1), match.sum(axis=1))
            return np.asarray(np.maximum(fewer, least).reshape(1, -1), np.float32)
        shared = self._shared[:, : len(rows) * len(columns)]
        turned = np.stack([np.roll(query, -shift, axis=1) for shift in range(self._shifts)])
        np.matmul(turned, match.T, out=shared.reshape(self._shifts, len(rows), len(columns)))
        return np.maximum(shared, least, out=shared)


def _inverse_transform(sectors: int) -> Float32Array:
    """`(sectors, 2 frequencies)`: from real and imaginary parts of a real signal's spectrum to the signal."""
    identity = np.eye(sectors // 2 + 1)
    return np.asarray(fft.irfft(np.concatenate([identity, 1j * identity]), n=sectors, axis=1).T, np.float32, order="C")
