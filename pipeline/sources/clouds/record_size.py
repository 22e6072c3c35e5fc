"""How long the records in a file of bare bytes are, by the bytes alone.

Records put each field's bytes at one place: what values a column of bytes takes, over all records, differs from place
to place, because signs and exponents of coordinates, intensities and ring numbers do.  Cut into pieces of any other
length, each column mixes all places, and the columns become alike.  So the place tells most of a byte (Goodman and
Kruskal's tau, 1954: by how much knowing the column helps to guess the value) for the true length and its multiples.
Nothing is assumed on the order of the points or on the scene.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_SIZES = range(9, 65)  # bytes; three int24 to sixteen float32
_SAMPLE = 2**19  # bytes looked at
_FEWEST = 200  # records
_CHANCE = 4.0  # times bytes in a record over bytes in all: what short files gain by chance stays below half of this
_LEAST = 0.003  # of tau; coordinates alone gain 0.006 and more
_NEAR = 0.7  # a length explains the bytes as well as the best one if by so much of it


def likely_record_size(raw: bytes, expected: int) -> int | None:
    """The length in bytes of the records in `raw`, or None where the bytes do not tell.

    Args:
        raw: the whole file.
        expected: a length that is kept if the bytes fit it as well as any other.
    """
    sample = np.frombuffer(raw, np.uint8, min(len(raw), _SAMPLE))
    if len(sample) < _FEWEST * max(_SIZES):
        return None
    # Four-byte numbers alone make every multiple of four explain something: what counts is how much more.
    common = _explained(sample, 4)
    gained = {size: _explained(sample, size) - common for size in _SIZES}
    best = max(gained.values())
    if best <= max(_LEAST, _CHANCE * max(_SIZES) / len(sample)):
        return None
    if gained[expected] >= _NEAR * best:
        return expected
    return next(size for size in _SIZES if gained[size] >= _NEAR * best)


def _explained(sample: NDArray[np.uint8], size: int) -> float:
    """Goodman and Kruskal's tau of the bytes' values by their columns, for records of `size` bytes."""
    table = sample[: len(sample) // size * size].reshape(-1, size) + np.arange(0, 256 * size, 256)
    shares = np.bincount(table.ravel(), minlength=256 * size).reshape(size, 256) / len(table)
    overall = float((shares.mean(axis=0) ** 2).sum())
    return (float((shares**2).sum(axis=1).mean()) - overall) / (1 - overall) if overall < 1 else 0.0
