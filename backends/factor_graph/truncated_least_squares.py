"""Truncated least squares: each measurement costs no more than an outlier does."""

from __future__ import annotations

import numpy as np

from wiclosure.types import FloatArray


def truncated_cost(chi_squares: FloatArray, known: int, limit: float) -> float:
    """Of known inliers, which come first, in full; of the others up to the limit."""
    return float(chi_squares[:known].sum() + np.minimum(chi_squares[known:], limit).sum())


def truncated_weights(chi_square: FloatArray, limit: float, mu: float) -> FloatArray:
    """Weights `(N,)` of the surrogate cost (eq. 14 of Yang et al.): 1 inside, 0 outside, falling between."""
    inside, outside = limit * mu / (mu + 1), limit * (mu + 1) / mu
    between = np.sqrt(limit * mu * (mu + 1) / np.clip(chi_square, inside, outside)) - mu
    return np.where(chi_square <= inside, 1.0, np.where(chi_square >= outside, 0.0, between))
