"""What is known of a closure: its prediction, its looks, its measured pose, and its distance from the estimate."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from wiclosure import se3
from wiclosure.arrays import FloatArray

# No useful closure is less exact, whatever it states: DiSCo-SLAM's have variances of a square metre, and as many
# square radians, which would leave nothing to object to.
_WORST_SIGMA = np.array([0.05, 0.05, 0.05, 0.5, 0.5, 0.5])
_REFUTATION_WEIGHT = 20.0


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


class PredictionKind(StrEnum):
    """What a prediction tells of a relative pose.

    `POSE`: where the match lies and how it is turned.  `HEADING`: how it is turned; of its position only that scans
    which overlap lie within the sensor's range of each other.
    """

    POSE = "pose"
    HEADING = "heading"


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Where the match should lie before any scan is registered: by radio, or by one robot's own odometry.

    Args:
        T_query_match: `(4, 4)`, match's body in the query's body.
        covariance: `(6, 6)`.
        kind: pose, or heading only.
    """

    T_query_match: FloatArray
    covariance: FloatArray
    kind: PredictionKind

    def __post_init__(self) -> None:
        _check_shapes("prediction", self.T_query_match, self.covariance)

    def __repr__(self) -> str:
        return f"Prediction({self.kind}, {_shown(self.T_query_match, self.covariance)})"

    def widened(self, factor: float) -> Prediction:
        """The same with standard deviations so many times as large."""
        return replace(self, covariance=factor**2 * self.covariance)


@dataclass(frozen=True, slots=True)
class ScanContextMatch:
    """How much two keyframes look alike.

    Args:
        distance: 1 - column cosine at the best shift, in [0, 1].
        yaw_rad: yaw of the match's body in the query's body at that shift.
    """

    distance: float
    yaw_rad: float


@dataclass(frozen=True, slots=True)
class RegistrationEvidence:
    """What speaks for a registered pose.

    Args:
        inliers: number of matched points, level ground left out.
        inlier_ratio: share of the points that matched, mean over both clouds, level ground left out.
        agreement: share of the points that match among those that match or lie in free space that the other sensor saw;
            of the cloud that has the smaller one.
        rms_m: root mean square of the distances of matched points; NaN where none matched.
        prediction_chi2: squared Mahalanobis distance from the prediction; None without one.
    """

    inliers: int
    inlier_ratio: float
    agreement: float
    rms_m: float
    prediction_chi2: float | None = None

    @property
    def score(self) -> float:
        """What decides between poses of the same clouds: a free-space conflict weighs twenty times a match.

        Between equal pillars a wrong pose may match more points than the true one, where what would contradict it is
        hidden or out of range.
        """
        return float(self.inlier_ratio * self.agreement**_REFUTATION_WEIGHT)


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A relative pose as a registration found it.

    Args:
        T_query_match: `(4, 4)`, match's body in the query's body.
        covariance: `(6, 6)`, right perturbation, `[rotation, translation]`.
        evidence: None for closures that others measured.
    """

    T_query_match: FloatArray
    covariance: FloatArray
    evidence: RegistrationEvidence | None = None

    def __post_init__(self) -> None:
        _check_shapes("measurement", self.T_query_match, self.covariance)

    def __repr__(self) -> str:
        inliers = "" if self.evidence is None else f", {self.evidence.inliers} inliers"
        return f"Measured({_shown(self.T_query_match, self.covariance)}{inliers})"


@dataclass(frozen=True, slots=True)
class Residual:
    """Distance and angle between a closure's pose and the final estimate."""

    translation_m: float
    rotation_rad: float


def _check_shapes(what: str, T_query_match: FloatArray, covariance: FloatArray) -> None:
    if np.shape(T_query_match) != (4, 4) or np.shape(covariance) != (6, 6):
        raise ValueError(
            f"{what}: T_query_match has shape {np.shape(T_query_match)}, covariance {np.shape(covariance)};"
            " expected (4, 4) and (6, 6)"
        )


def _shown(T_query_match: FloatArray, covariance: FloatArray) -> str:
    """How far and how turned a pose is, and how exactly it is known."""
    distance_m = float(np.linalg.norm(T_query_match[:3, 3]))
    sigma_rad, sigma_m = (float(np.sqrt(np.trace(block) / 3)) for block in (covariance[:3, :3], covariance[3:, 3:]))
    turn_rad = float(se3.rotation_angle(T_query_match))
    return f"{distance_m:.2f} m, {turn_rad:.3f} rad, sigma {sigma_m:.2f} m and {sigma_rad:.3f} rad"
