"""Gates: is a pair near enough to be compared?

Each gate also answers for whole groups of pairs, from a lower bound of their distance and bounds of their covariance:
`may_keep` is never false where the gate would keep one of the pairs.  That is all that the overlap search has to know.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from wiclosure.types import BoolArray, FloatArray
from wiclosure.wiclosure_filter.config import GateSettings
from wiclosure.wiclosure_filter.search.ball_probability import probability_within

# Bounds are computed in another order than the pairs' own values, and determinants of flat ellipses lose digits:
# rounding must not lose a pair on the edge.
ROUNDING = 1.0 + 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class GateScores:
    """Decision of a gate on M pairs: kept or not `(M,)`, and of the K kept ones both scores `(K,)`."""

    keep: BoolArray
    overlap_probability: FloatArray
    mahalanobis: FloatArray


class Gate(Protocol):
    """Decides on pairs by their predicted displacement."""

    def may_keep(self, distance: FloatArray, largest_variance: FloatArray, smallest_spread: FloatArray) -> BoolArray:
        """False `(K,)` only where no pair of the group can be kept.

        Args:
            distance: `(K,)` m, no displacement of the group is shorter.
            largest_variance: `(K,)` m^2, no displacement of the group has a larger variance in any direction.
            smallest_spread: `(K,)` m^2, no covariance of the group has a smaller `det(covariance)^(1/d)`.
        """
        ...

    def score(self, displacement: FloatArray, covariance: FloatArray) -> GateScores:
        """Decides on pairs.

        Args:
            displacement: `(M, d)` m, from one robot's pose to the other's, d = 2 or 3.
            covariance: `(M, d, d)` m^2.
        """
        ...


def make_gate(settings: GateSettings) -> Gate:
    """The gate that the settings name."""
    if settings.method == "mahalanobis":
        return MahalanobisGate(settings.mahalanobis_threshold, settings.sensor_range_m)
    return OverlapProbabilityGate(settings.sensor_range_m, settings.min_probability)


class MahalanobisGate:
    """The paper's gate (eq. 7): may the two poses be the same place?

    Far pairs are kept where the prediction is poor, and pairs certainly ten metres apart are not.

    Args:
        threshold: D, in standard deviations of the displacement.
        sensor_range_m: for the probability of overlap that is told of kept pairs.
    """

    def __init__(self, threshold: float, sensor_range_m: float) -> None:
        self.threshold = threshold
        self.radius_m = sensor_range_m

    def may_keep(self, distance: FloatArray, largest_variance: FloatArray, smallest_spread: FloatArray) -> BoolArray:
        """|x|^2 / lambda_max <= d_MH^2: the paper's buffer D * sigma_UB."""
        return np.asarray(distance <= self.threshold * np.sqrt(largest_variance) * ROUNDING)

    def score(self, displacement: FloatArray, covariance: FloatArray) -> GateScores:
        """Keeps what is nearer than D."""
        mahalanobis = mahalanobis_distance(displacement, covariance)
        keep = mahalanobis < self.threshold
        probability = probability_within(displacement[keep], covariance[keep], self.radius_m)
        return GateScores(keep, probability, mahalanobis[keep])


class OverlapProbabilityGate:
    """Keeps pairs that are within the sensor's range with at least a given probability.

    Args:
        sensor_range_m: distance up to which two scans overlap.
        min_probability: of being nearer than that.
    """

    def __init__(self, sensor_range_m: float, min_probability: float) -> None:
        self.radius_m = sensor_range_m
        self.min_probability = min_probability

    def may_keep(self, distance: FloatArray, largest_variance: FloatArray, smallest_spread: FloatArray) -> BoolArray:
        """Whether the bound on the probability reaches the threshold."""
        bound = probability_bound(distance, largest_variance, smallest_spread, self.radius_m)
        return np.asarray(bound * ROUNDING >= self.min_probability)

    def score(self, displacement: FloatArray, covariance: FloatArray) -> GateScores:
        """Computes the probability only where its bound is high enough."""
        distance = np.linalg.norm(displacement, axis=1)
        bound = probability_bound(distance, *spread(covariance), self.radius_m)
        keep = bound >= self.min_probability
        # Quadrature errs by up to 1e-4: without the minimum it could keep what `may_keep` rules out.
        probability = np.minimum(probability_within(displacement[keep], covariance[keep], self.radius_m), bound[keep])
        probable = probability >= self.min_probability
        keep[keep] = probable
        return GateScores(keep, probability[probable], mahalanobis_distance(displacement[keep], covariance[keep]))


def probability_bound(
    distance: FloatArray, largest_variance: FloatArray, smallest_spread: FloatArray, radius: float
) -> FloatArray:
    """No Gaussian displacement in the plane or in space is within the radius with a higher probability.

    Two bounds, both monotonic in their arguments, the smaller counts.  *Half space*: the ball lies behind the plane
    that touches it towards the mean, `P <= Phi(-(distance - R) / sigma_max)`; sharp for small variances.  *Density*:
    volume of the ball times the highest density in it, sharp for large ones.

    Args:
        distance: `(K,)` of the mean, or a lower bound.
        largest_variance: `(K,)`, or an upper bound.
        smallest_spread: `(K,)`, `det^(1/d)`, or a lower bound.
        radius: of the ball.
    """
    from scipy.special import ndtr

    beyond = np.maximum(distance - radius, 0.0) / np.sqrt(largest_variance)
    half_space = np.where(beyond > 0, ndtr(-beyond), 1.0)
    # d = 2: pi R^2 / (2 pi sqrt(det)).  With u = R^2 / spread this is u/2; in space it would be 0.27 u^(3/2): smaller
    # for u < 1, and for u >= 1 u/2 exp(-b^2/2) holds because the half space has Phi(-b) <= exp(-b^2/2) / 2.
    density = radius**2 / (2.0 * smallest_spread) * np.exp(-0.5 * beyond**2)
    return np.asarray(np.minimum(half_space, density))


def spread(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Largest variance and `det^(1/d)` `(M,)` of covariances `(M, d, d)`."""
    if covariance.shape[-1] != 2:
        variance = np.maximum(np.linalg.eigvalsh(covariance), np.finfo(float).tiny)
        return variance[:, -1], np.prod(variance, axis=1) ** (1.0 / variance.shape[1])
    xx, xy, yy = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    largest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
    return largest, np.sqrt(np.maximum(xx * yy - xy**2, np.finfo(float).tiny))


def mahalanobis_distance(displacement: FloatArray, covariance: FloatArray) -> FloatArray:
    """`sqrt(x^T covariance^-1 x)` `(M,)` (paper, eq. 6)."""
    solved = np.linalg.solve(covariance, displacement[:, :, None])[:, :, 0]
    squared = np.einsum("mi,mi->m", displacement, solved)
    return np.asarray(np.sqrt(np.maximum(squared, 0.0)))
