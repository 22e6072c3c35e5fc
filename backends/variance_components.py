"""Separate factors on the standard deviations of odometry and closures, of rotation and translation.

Variance component estimation (Helmert 1907; Förstner 1979): of each component, the squared residuals over how much of
them the redundancy of the graph shows.  Repeated under the new factors until nothing changes, it splits what one
factor for all would mix: edges without information are stated as known to a metre and to a radian alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wiclosure.types import BoolArray, FloatArray

ENOUGH = 20.0  # redundant measurements from which a component has a factor of its own
ROUNDS = 8
CONVERGED = 1.1  # factors nearer to 1
ALIKE = 2.25  # factors that differ by less are taken for one: each is within 1.5 of the middle


@dataclass(frozen=True, eq=False)
class VarianceComponents:
    """What residuals say of odometry (first row) and closures, of rotation (first column) and translation.

    Args:
        squared: `(2, 2)` sums of squared whitened residuals.
        redundancy: `(2, 2)` what these are expected to be.
    """

    squared: FloatArray
    redundancy: FloatArray

    @classmethod
    def of(cls, residuals: FloatArray, expected: FloatArray, odometry: BoolArray, degrees: int) -> VarianceComponents:
        """From whitened residuals `(M, 6)` and the variance `(M, 6)` expected of them; odometry or closures `(M,)`."""
        rotation, translation = (slice(2, 3), slice(3, 5)) if degrees == 3 else (slice(0, 3), slice(3, 6))
        sums = (
            np.array([[of[rows, part].sum() for part in (rotation, translation)] for rows in (odometry, ~odometry)])
            for of in (residuals**2, expected)
        )
        return cls(*sums)

    @property
    def factors(self) -> FloatArray:
        """`(2, 2)` on the standard deviations; where redundancy is too little, that of the same unit, or else 1."""
        told = self.redundancy >= ENOUGH
        found = np.sqrt(self.squared / np.maximum(self.redundancy, 1e-12))
        of_unit = np.where(told.any(axis=0), np.where(told, found, 0.0).max(axis=0), 1.0)
        return np.where(told, np.maximum(found, 1e-6), of_unit)


def separate_factors(components: VarianceComponents, under: Callable[[FloatArray], VarianceComponents]) -> FloatArray:
    """Factors `(2, 2)` under which the components agree with what is stated; all 1 where they are much alike.

    Args:
        components: as stated.
        under: those found under factors.
    """
    factors = np.ones((2, 2))
    if _alike(components.factors):
        return factors
    for _ in range(ROUNDS):
        change = components.factors
        factors = factors * change
        if np.abs(np.log(change)).max() <= np.log(CONVERGED):
            break
        components = under(factors)
    return np.ones((2, 2)) if _alike(factors) else factors


def _alike(factors: FloatArray) -> bool:
    return bool(factors.max() <= ALIKE * factors.min())


def restated(covariance: FloatArray, factors: FloatArray) -> FloatArray:
    """Covariances `(..., 6, 6)` with standard deviations of rotation and translation times `factors (2,)`."""
    times = np.repeat(factors, 3)
    return np.asarray(covariance * np.outer(times, times))
