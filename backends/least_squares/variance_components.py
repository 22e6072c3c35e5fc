"""Separate factors on the standard deviations of rotation and of translation.

Variance component estimation (Helmert 1907; Förstner 1979): of each component, the squared residuals over how much of
them the redundancy of the graph shows.  Repeated under the new factors until nothing changes, it splits what one
factor for all would mix: edges without information are read as known to a metre and to a radian alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray

ENOUGH = 20.0  # redundant measurements from which a component has a factor of its own
ROUNDS = 8
CONVERGED = 1.1  # factors nearer to 1
ALIKE = 2.25  # factors that differ by less are taken for one: each is within 1.5 of the middle


@dataclass(frozen=True, eq=False)
class VarianceComponents:
    """What residuals say of rotation and of translation.

    Args:
        squared: `(2,)` sums of squared whitened residuals.
        redundancy: `(2,)` what these are expected to be.
    """

    squared: FloatArray
    redundancy: FloatArray

    @classmethod
    def none(cls) -> VarianceComponents:
        """Of no residuals."""
        return cls(np.zeros(2), np.zeros(2))

    def scaled(self, scale: float) -> VarianceComponents:
        """The same with all standard deviations so many times as large."""
        return VarianceComponents(self.squared / scale**2, self.redundancy)

    def without(self, part: VarianceComponents) -> VarianceComponents:
        """Of the other residuals."""
        return VarianceComponents(self.squared - part.squared, self.redundancy - part.redundancy)

    @classmethod
    def of(cls, residuals: FloatArray, expected: FloatArray, degrees: int) -> VarianceComponents:
        """From whitened residuals `(M, K)` and the variances `(M, K)` expected of them, for 3 or 6 degrees of freedom.

        Whitening by a triangular matrix leaves the first three of six, the first of three, to rotation alone.
        """
        if residuals.shape[1] == 3:
            parts = slice(0, 1), slice(1, 3)
        else:
            parts = (slice(2, 3), slice(3, 5)) if degrees == 3 else (slice(0, 3), slice(3, 6))
        squared, redundancy = (
            np.array([of_edges[:, part].sum() for part in parts]) for of_edges in (residuals**2, expected)
        )
        return cls(squared, redundancy)

    @property
    def factors(self) -> FloatArray:
        """`(2,)` on the standard deviations; 1 where redundancy is too little."""
        found = np.sqrt(np.maximum(self.squared, 1e-12) / np.maximum(self.redundancy, 1e-12))
        return np.where(self.redundancy >= ENOUGH, found, 1.0)


def separate_factors(
    components: VarianceComponents,
    under: Callable[[FloatArray], VarianceComponents],
    bounds: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """Factors `(2,)` under which the residuals are as expected; both 1 where they are much alike.

    Args:
        components: as stated.
        under: those found under factors.
        bounds: least and most `(2,)` of the factors; where all is exact, there is no other end.
    """
    factors = np.clip(components.factors, *bounds)
    if _alike(factors):
        return np.ones(2)
    for _ in range(ROUNDS):
        before, factors = factors, np.clip(factors * under(factors).factors, *bounds)
        if np.abs(np.log(factors / before)).max() <= np.log(CONVERGED):
            break
    return np.ones(2) if _alike(factors) else factors


def _alike(factors: FloatArray) -> bool:
    return bool(factors.max() <= ALIKE * factors.min())


def restated(covariance: FloatArray, factors: float | FloatArray) -> FloatArray:
    """Covariances `(..., 6, 6)` with standard deviations times one factor, or `(2,)` of rotation and translation."""
    times = np.repeat(np.broadcast_to(factors, 2), 3)
    return np.asarray(covariance * np.outer(times, times))


def restated_parts(parts: FloatArray, factors: float | FloatArray) -> FloatArray:
    """What is stated of rotation, of both, and of translation `(3, M, 6, 6)`, likewise."""
    rotation, translation = np.broadcast_to(factors, 2)
    squared = np.array([rotation**2, rotation * translation, translation**2])
    return np.asarray(squared[:, None, None, None] * parts)


def summed(parts: FloatArray, factors: float | FloatArray) -> FloatArray:
    """Covariances `(M, 6, 6)` of those parts, likewise."""
    return np.asarray(restated_parts(parts, factors).sum(axis=0))
