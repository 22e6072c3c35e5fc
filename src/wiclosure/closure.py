"""Claims that two keyframes see the same place, and how far each came."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Self

import numpy as np

from wiclosure import se3
from wiclosure.arrays import FloatArray
from wiclosure.evidence import Measured, Prediction, RegistrationEvidence, Residual, ScanContextMatch


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
    if not measured:
        return np.zeros((0, 4, 4)), np.zeros((0, 6, 6))
    return np.stack([m.T_query_match for m in measured]), np.stack([m.covariance for m in measured])
