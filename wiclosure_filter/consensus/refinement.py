"""Climbs from many proposed frame transforms to the peaks of the likelihood, all at once.

Expectation maximisation: the mixture says which path (or none) explains each measurement, a damped Gauss-Newton step
fits the transform to that, and so on.  The last step's normal matrix is the information of the result.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.likelihood.mixture import Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations
from wiclosure.wiclosure_filter.likelihood.residuals import displacements_in_a, residual_rows

_FIRST_STEPS = 5
_LAST_STEPS = 15
SAME_PEAK_M = 0.3
_APART_FRACTION = 0.15  # of the robots' distance: alignments nearer than this are one, see `same_place_fraction`
_DAMPING = 1e-3
_CONVERGED = 1e-7


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known before a measurement is looked at.

    Args:
        yaw: rad by the robots' headings, or NaN.
        yaw_sigma: rad.
        height_m: most likely `z` of the state: antennas at equal height.
        height_sigma_m: m.
    """

    yaw: float
    yaw_sigma: float
    height_m: float
    height_sigma_m: float

    @classmethod
    def of(cls, observations: Observations, *, use_headings: bool, height_sigma_m: float) -> Prior:
        """Prior of a set of observations; headings that repeat themselves do not add up.

        Args:
            observations: the measurements.
            use_headings: whether compasses count.
            height_sigma_m: m, how differently high the robots may be.
        """
        known = np.isfinite(observations.yaw) & use_headings
        yaw = float(np.angle(np.exp(1j * observations.yaw[known]).sum())) if known.any() else np.nan
        sigma = float(np.median(observations.yaw_sigma[known])) if known.any() else np.nan
        return cls(yaw, sigma, 0.0, height_sigma_m)  # centred heights: equal on average is z = 0

    def log_density(self, states: FloatArray) -> FloatArray:
        """`(N,)`, up to a constant."""
        density = -((states[:, 3] - self.height_m) ** 2) / (2 * self.height_sigma_m**2)
        if np.isfinite(self.yaw):
            density += (np.cos(states[:, 0] - self.yaw) - 1) / self.yaw_sigma**2
        return np.asarray(density)

    def add_to(self, states: FloatArray, information: FloatArray, gradient: FloatArray) -> None:
        """Adds the prior to normal equations."""
        information[:, 3, 3] += self.height_sigma_m**-2
        gradient[:, 3] += (self.height_m - states[:, 3]) * self.height_sigma_m**-2
        if np.isfinite(self.yaw):
            information[:, 0, 0] += self.yaw_sigma**-2
            gradient[:, 0] += np.sin(self.yaw - states[:, 0]) * self.yaw_sigma**-2


@dataclass(frozen=True, eq=False)
class Peaks:
    """N local maxima of the posterior.

    Args:
        states: `(N, 4)`.
        log_posterior: `(N,)`.
        information: `(N, 4, 4)`, inverse covariances of the states.
    """

    states: FloatArray
    log_posterior: FloatArray
    information: FloatArray

    def __len__(self) -> int:
        return len(self.states)

    @classmethod
    def at(cls, states: FloatArray, mixture: Mixture, prior: Prior) -> Peaks:
        """States as they are, with the posterior and its curvature there."""
        value, information, _ = normal_equations(states, mixture, prior)
        return cls(states, value, information)

    def subset(self, rows: IntArray) -> Peaks:
        """The peaks at `rows`."""
        return Peaks(self.states[rows], self.log_posterior[rows], self.information[rows])

    def distinct(self, observations: Observations) -> Peaks:
        """Best first, without those that stand where a better one does."""
        ordered = self.subset(np.argsort(-self.log_posterior, kind="stable"))
        states = ordered.states
        return ordered.subset(
            first_distinct(len(states), lambda row: displacement_m(states, states[row], observations), SAME_PEAK_M)
        )


def climb(states: FloatArray, mixture: Mixture, prior: Prior, finalists: int = 6) -> Peaks:
    """Refines states `(N, 4)` to the nearest peaks; only the `finalists` most promising go all the way.

    As many again go all the way that lie apart from each other: the most promising may all be on one long ridge.
    """
    observations = mixture.observations
    climbed = _steps(states, mixture, prior, _FIRST_STEPS).distinct(observations)
    apart = first_distinct(
        len(climbed),
        lambda row: displacement_m(climbed.states, climbed.states[row], observations),
        _APART_FRACTION * observations.typical_distance_m,
        limit=finalists,
    )
    rows = np.union1d(np.arange(min(finalists, len(climbed))), apart)
    return _steps(climbed.states[rows], mixture, prior, _LAST_STEPS)


def _steps(states: FloatArray, mixture: Mixture, prior: Prior, count: int) -> Peaks:
    """At most `count` steps uphill; the highest point that was passed is kept."""
    best, best_value = states, np.full(len(states), -np.inf)
    best_information = np.zeros((len(states), 4, 4))
    for left in range(count, -1, -1):
        value, information, gradient = normal_equations(states, mixture, prior)
        better = value > best_value
        best = np.where(better[:, None], states, best)
        best_value = np.where(better, value, best_value)
        best_information = np.where(better[:, None, None], information, best_information)
        step = _solved(information, gradient)
        if left == 0 or np.abs(step).max(initial=0.0) < _CONVERGED:
            break
        states = states + step
    return Peaks(best, best_value, best_information)


def _solved(information: FloatArray, gradient: FloatArray) -> FloatArray:
    """Damped steps, at most half a radian and ten metres long."""
    diagonal = np.einsum("nii->ni", information)
    damped = information.copy()
    np.einsum("nii->ni", damped)[:] += _DAMPING * diagonal + 1e-6
    step = np.linalg.solve(damped, gradient[..., None])[..., 0]
    shrink = np.maximum(np.abs(step[:, 0]) / 0.5, np.linalg.norm(step[:, 1:], axis=1) / 10.0)
    return np.asarray(step / np.maximum(shrink, 1.0)[:, None])


def normal_equations(states: FloatArray, mixture: Mixture, prior: Prior) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Log-posterior `(N,)`, Gauss-Newton information `(N, 4, 4)` and gradient `(N, 4)` at N states."""
    observations = mixture.observations
    turned, w = displacements_in_a(states, observations)
    rows = residual_rows(w, states[:, :1], mixture)
    jacobian = np.empty((*rows.by_w.shape[:-1], 4))
    jacobian[..., 1:] = rows.by_w
    jacobian[..., 0] = rows.by_yaw
    jacobian[..., 0] += rows.by_w[..., 1] * turned[..., None, 0] - rows.by_w[..., 0] * turned[..., None, 1]
    weighted = (rows.weight * observations.independence[:, None]).reshape(len(states), -1, 1)
    jacobian = jacobian.reshape(len(states), -1, 4)
    transposed = np.swapaxes(weighted * jacobian, 1, 2)
    information = transposed @ jacobian
    gradient = (transposed @ rows.residual.reshape(len(states), -1, 1))[..., 0]
    prior.add_to(states, information, gradient)
    value = rows.log_likelihood @ observations.independence + prior.log_density(states)
    return value, information, gradient


def displacement_m(states: FloatArray, others: FloatArray, observations: Observations) -> FloatArray:
    """Root mean square distance between the places that two transforms give to b's antennas, horizontally."""
    off = states - others
    # b is centred: turning and shifting do not mix
    turned = 2 * observations.spread_b_m2 * (1 - np.cos(off[..., 0]))
    return np.asarray(np.sqrt(turned + off[..., 1] ** 2 + off[..., 2] ** 2))


def first_distinct(
    count: int, distances_to: Callable[[int], FloatArray], least: float, limit: int | None = None
) -> IntArray:
    """Rows of which no two are the same: of those nearer to each other than `least`, the first.

    Args:
        count: how many there are, the best first.
        distances_to: distances `(count,)` of all to the one in a row.
        least: distance from which two are different.
        limit: rows at most.
    """
    free = np.ones(count, bool)
    kept: list[int] = []
    while free.any() and (limit is None or len(kept) < limit):
        kept.append(int(np.argmax(free)))
        free &= distances_to(kept[-1]) > least
        free[kept[-1]] = False  # whatever rounding makes of the distance to itself
    return np.array(kept, np.int64)
