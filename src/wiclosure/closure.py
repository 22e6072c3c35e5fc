"""Claims that two keyframes see the same place: what is known of each, and how far it came."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum
from typing import Self

import numpy as np

from wiclosure import se3
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

    def __str__(self) -> str:
        return f"{self.robot} {self.index}"


class Stage(IntEnum):
    """What decides on a closure, in this order.

    Matching proposes it by its looks, registration measures it, the radio check holds the measured pose against what
    the filter knows, the consistency check (PCM) against other closures, the estimate against all of them together.
    """

    MATCHING = 1
    REGISTRATION = 2
    RADIO_CHECK = 3
    CONSISTENCY = 4
    ESTIMATE = 5

    def __str__(self) -> str:
        return self.name.lower().replace("_", " ")


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


@dataclass(frozen=True, slots=True)
class Residual:
    """Distance and angle between a closure's pose and the final estimate."""

    translation_m: float
    rotation_rad: float


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Closure:
    """A claim that two keyframes see the same place: the one type that flows from matching to the map.

    Decisions only go forward: `measured_as`, `accepted` and `rejected` give the closure as the next stage leaves it.

    Args:
        query, match: the keyframes.
        prediction: where the match should lie, if anything tells.
        scan_context: what matching found; None for closures that others proposed.
        overlap_probability: by the filter, if it says.
        measured: relative pose; None before registration, and where there was too little to register.
        passed: the last stage that let it through.
        rejected_at: the stage that rejected it, or None.
        reason: why it was rejected or accepted, one phrase.
        consistent_with: how many other closures of the robot pair agree (PCM degree).
        residual: distance from the final estimate; None before, and where the robots are not connected.

    Raises:
        ValueError: it passed registration without a measured pose, or was rejected at an earlier stage than it passed.
    """

    query: KeyframeId
    match: KeyframeId
    prediction: Prediction | None = None
    scan_context: ScanContextMatch | None = None
    overlap_probability: float | None = None
    measured: Measured | None = None
    passed: Stage = Stage.MATCHING
    rejected_at: Stage | None = None
    reason: str = ""
    consistent_with: int = 0
    residual: Residual | None = None

    def __post_init__(self) -> None:
        latest = self.passed if self.rejected_at is None else max(self.passed, self.rejected_at - 1)
        if self.measured is None and latest >= Stage.REGISTRATION:
            raise ValueError(f"closure {self.query} to {self.match} is past registration and has no measured pose")
        if self.rejected_at is not None and self.rejected_at < self.passed:
            raise ValueError(
                f"closure {self.query} to {self.match} has passed {self.passed}; {self.rejected_at} comes before that"
            )

    def __repr__(self) -> str:
        fate = f"passed {self.passed}" if self.rejected_at is None else f"rejected at {self.rejected_at}"
        return f"Closure({self.query} to {self.match}, {fate}{f': {self.reason}' if self.reason else ''})"

    @classmethod
    def from_measurement(
        cls, query: KeyframeId, match: KeyframeId, T_query_match: FloatArray, covariance: FloatArray
    ) -> Self:
        """A closure that others measured and vouch for: it has passed registration."""
        return cls(query, match, measured=Measured(T_query_match, covariance), passed=Stage.REGISTRATION)

    @property
    def live(self) -> bool:
        """Whether it has a measured pose that no stage has rejected so far."""
        return self.passed >= Stage.REGISTRATION and self.rejected_at is None

    @property
    def evidence(self) -> RegistrationEvidence | None:
        """What registration found, if it did."""
        return None if self.measured is None else self.measured.evidence

    @property
    def best_T_query_match(self) -> FloatArray:
        """`(4, 4)`: measured; before that predicted; before that at one place, turned by scan context's yaw."""
        if self.measured is not None:
            return self.measured.T_query_match
        if self.prediction is not None:
            return self.prediction.T_query_match
        return se3.from_yaw(0.0 if self.scan_context is None else self.scan_context.yaw_rad, np.zeros(3))

    def survived(self, stage: Stage) -> bool:
        """Whether this stage let it through.  A stage that was left out lets everything through."""
        return stage <= self.passed if self.rejected_at is None else stage < self.rejected_at

    def measured_as(self, measured: Measured) -> Closure:
        """With the pose that registration found; whether to accept it is still open.

        Raises:
            ValueError: it was rejected, or has passed registration.
        """
        self._require_open(Stage.REGISTRATION)
        if self.passed >= Stage.REGISTRATION:
            raise ValueError(f"{self} was measured before")
        return replace(self, measured=measured)

    def accepted(self, stage: Stage, reason: str = "") -> Closure:
        """As a stage leaves it that lets it through; without a reason the one so far stays.

        Raises:
            ValueError: it was rejected, or has passed a later stage, or has no measured pose.
        """
        self._require_open(stage)
        return replace(self, passed=stage, reason=reason or self.reason)

    def rejected(self, stage: Stage, reason: str) -> Closure:
        """As a stage leaves it that rejects it.

        Raises:
            ValueError: it was rejected before, or has passed a later stage.
        """
        self._require_open(stage)
        return replace(self, rejected_at=stage, reason=reason)

    def _require_open(self, stage: Stage) -> None:
        if self.rejected_at is not None:
            raise ValueError(f"{self} was decided on; {stage} cannot decide again")
        if stage < self.passed:
            raise ValueError(f"{self}: {stage} comes before that and cannot decide any more")


def survivors(closures: Iterable[Closure], stage: Stage) -> list[Closure]:
    """The closures that a stage let through; how many survived it is their number."""
    return [closure for closure in closures if closure.survived(stage)]


def measured_poses(closures: Sequence[Closure]) -> tuple[FloatArray, FloatArray]:
    """Measured `T_query_match (N, 4, 4)` and covariances `(N, 6, 6)`.

    Raises:
        ValueError: a closure has no measured pose.
    """
    if missing := next((closure for closure in closures if closure.measured is None), None):
        raise ValueError(f"{missing} has no measured pose")
    measured = [closure.measured for closure in closures if closure.measured is not None]
    T_query_match = np.array([m.T_query_match for m in measured], float).reshape(-1, 4, 4)
    return T_query_match, np.array([m.covariance for m in measured], float).reshape(-1, 6, 6)


def _check_shapes(what: str, T_query_match: FloatArray, covariance: FloatArray) -> None:
    if np.shape(T_query_match) != (4, 4) or np.shape(covariance) != (6, 6):
        raise ValueError(
            f"{what}: T_query_match has shape {np.shape(T_query_match)}, covariance {np.shape(covariance)};"
            " expected (4, 4) and (6, 6)"
        )
