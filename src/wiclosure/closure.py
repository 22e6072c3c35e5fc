"""Claims that two keyframes see the same place, with their evidence and how far they came."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from wiclosure.arrays import FloatArray

# No closure worth having is less exact, whatever it states: DiSCo-SLAM's have variances of a square metre, and as many
# square radians, which would leave nothing to object to.
_WORST_SIGMA = np.array([0.05, 0.05, 0.05, 0.5, 0.5, 0.5])


def capped_covariance(covariance: FloatArray) -> FloatArray:
    """A stated covariance `(6, 6)` of at most 0.05 rad and 0.5 m: for holding a measured pose against what is known.

    Directions that are stated to be vaguer are cut to that, in units of it; others stay as they are.
    """
    if not np.isfinite(covariance).all():
        return np.diag(np.square(_WORST_SIGMA))
    scale = np.outer(_WORST_SIGMA, _WORST_SIGMA)
    variances, axes = np.linalg.eigh(covariance / scale)
    if variances[-1] <= 1.0:
        return covariance
    return np.asarray((axes * np.minimum(variances, 1.0)) @ axes.T * scale)


@dataclass(frozen=True, slots=True, order=True)
class KeyframeId:
    """Names a keyframe: the robot, and the keyframe's index in that robot's keyframe trajectory."""

    robot: str
    index: int


class Decision(StrEnum):
    """How far a closure came."""

    PROPOSED = "proposed"
    VERIFIED = "verified"
    ACCEPTED = "accepted"
    REJECTED = "rejected"


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is known of a closure; NaN where a stage did not say.

    Args:
        scan_context_distance: 1 - column cosine at the best shift, in [0, 1].
        scan_context_yaw: rad, yaw of the match's body in the query's body.
        overlap_probability: from the filter.
        prior_chi2: squared Mahalanobis distance of the registration from the filter's prediction.
        inliers: number of matched points after registration, level ground left out.
        inlier_ratio: share of the points that matched, mean over both clouds, level ground left out.
        agreement: share of the points that matched among those that matched or that the other sensor looked through.
        rms_m: root mean square of the distances of matched points.
        consistent_with: how many other closures of the robot pair agree (PCM degree).
        residual_m, residual_rad: distance and angle between the measurement and the final estimate.
    """

    scan_context_distance: float = float("nan")
    scan_context_yaw: float = float("nan")
    overlap_probability: float = float("nan")
    prior_chi2: float = float("nan")
    inliers: int = 0
    inlier_ratio: float = float("nan")
    agreement: float = float("nan")
    rms_m: float = float("nan")
    consistent_with: int = 0
    residual_m: float = float("nan")
    residual_rad: float = float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """A claim that two keyframes see the same place: the one type that flows from matching to the graph.

    Args:
        query, match: the keyframes.
        T_query_match: `(4, 4)`, match's body in the query's body: a guess while proposed, measured when verified.
        covariance: `(6, 6)` of the measurement.
        evidence: what is known of it.
        decision: how far it came.
        reason: why it was rejected or accepted, one phrase.
    """

    query: KeyframeId
    match: KeyframeId
    T_query_match: FloatArray
    covariance: FloatArray
    evidence: Evidence
    decision: Decision
    reason: str = ""

    @property
    def located(self) -> bool:
        """Whether it was predicted where the match lies, see `CandidatePairs.located`."""
        return self.query.robot == self.match.robot or bool(np.isfinite(self.evidence.overlap_probability))
