"""Continuous systematic errors, estimated along with the alignment, or left to its covariance where nothing tells.

Seven numbers describe what is constant over a log and never quite what it is said to be: bias and scale of the ranges,
the difference of the clocks, how each antenna array is mounted, and how each odometry is scaled.  They stand beside the
chain of frame transforms as nuisance parameters with Gaussian priors.  The chain's equations are banded, and bordered
by theirs: one Schur complement gives their estimates, and what they leave open of the alignment, as a Schmidt-Kalman
filter has it.  Scales are those of ranges and odometry against each other: a map is as long as its odometry.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.types import Calibration, FloatArray, IntArray, Trajectory
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.drift.error_prior import ErrorPrior
from wiclosure.wiclosure_filter.likelihood.mixture import Explanation
from wiclosure.wiclosure_filter.likelihood.observations import Observations

BIAS, RANGE_SCALE, CLOCK, AZIMUTH_A, AZIMUTH_B, SCALE_A, SCALE_B = range(7)
COUNT = 7
_EXCHANGED = (BIAS, RANGE_SCALE, CLOCK, AZIMUTH_B, AZIMUTH_A, SCALE_B, SCALE_A)  # where a and b change places
CONSTANT_BLUNDER = 0.02  # share of logs in which a bias, a clock, a mounting angle or an odometry's scale is a blunder


@dataclass(frozen=True, eq=False)
class SystematicErrors:
    """How M measurements in order of time, and the steps between them, depend on the seven errors.

    Args:
        observations: as the log has them.
        velocity_b: `(M, 3)` m/s of b, in its odometry axes.
        yaw_rate_b: `(M,)` rad/s of b; 0 where the axes of the angles do not turn with it.
        moved_a, moved_b: `(M, 3)` m from where each robot was in the middle of the time.
        prior_sigma: `(7,)` of the Gaussians that hold the errors near zero, see `ErrorPrior.held`; `(B, 7)` of the
            measurements of B pairs of robots.
    """

    observations: Observations
    velocity_b: FloatArray
    yaw_rate_b: FloatArray
    moved_a: FloatArray
    moved_b: FloatArray
    prior_sigma: FloatArray

    @classmethod
    def of(cls, observations: Observations, odometry: PairOdometry, prior_sigma: FloatArray) -> SystematicErrors:
        """Of measurements in order of time."""
        middle = len(observations) // 2
        moved_a, moved_b = (antenna - antenna[middle] for antenna in (observations.a, observations.b))
        return cls(observations, *motion(odometry.b, observations.index_b), moved_a, moved_b, prior_sigma)

    @classmethod
    def joined(cls, parts: Sequence[SystematicErrors]) -> SystematicErrors:
        """Of B pairs of robots one after the other: their errors are `(B, 7)`, and `(M, 7)` for each measurement."""
        return cls(
            Observations.joined([part.observations for part in parts]),
            np.concatenate([part.velocity_b for part in parts]),
            np.concatenate([part.yaw_rate_b for part in parts]),
            np.concatenate([part.moved_a for part in parts]),
            np.concatenate([part.moved_b for part in parts]),
            np.vstack([part.prior_sigma for part in parts]),
        )

    def first_guess(self, explanation: Explanation, distance_m: FloatArray) -> FloatArray:
        """`(7,)` to start from: no error, but for ranges of which most are too long as if obstructed.

        Args:
            explanation: of the measurements by a rigid transform; leading dimension 1.
            distance_m: `(M,)` of the antennas by it.
        """
        guess = np.zeros(COUNT)
        in_sight, obstructed = explanation.in_sight[0], explanation.obstructed[0]
        if obstructed.sum() > in_sight.sum():
            agreeing = in_sight + obstructed > 0.5
            guess[BIAS] = np.median((self.observations.range_m - distance_m)[agreeing]) if agreeing.any() else 0.0
        return guess

    def corrected(self, errors: FloatArray) -> Observations:
        """The measurements as they would be without the errors `(7,)`, or `(M, 7)` of each."""
        observations = self.observations
        turn = -np.where(observations.a_receives, errors[..., AZIMUTH_A], errors[..., AZIMUTH_B])
        turn = turn + np.where(observations.a_receives, 0.0, self.yaw_rate_b * errors[..., CLOCK])
        R = se3.from_yaw(turn, np.zeros((len(turn), 3)))[:, :3, :3]
        scaled_b = observations.b + errors[..., SCALE_B, None] * self.moved_b
        return replace(
            observations,
            a=observations.a + errors[..., SCALE_A, None] * self.moved_a,
            b=scaled_b + errors[..., CLOCK, None] * self.velocity_b,
            range_m=np.maximum(observations.range_m - errors[..., BIAS], 0.0) / (1 + errors[..., RANGE_SCALE]),
            direction=np.einsum("mij,mkj->mki", R, observations.direction),
        )

    def of_measured(self) -> FloatArray:
        """`(M, 3, 7)` derivatives of the predicted azimuth, elevation and range by the errors."""
        a_receives = self.observations.a_receives
        by_errors = np.zeros((len(a_receives), 3, COUNT))
        by_errors[:, 0, AZIMUTH_A], by_errors[:, 0, AZIMUTH_B] = a_receives, ~a_receives
        by_errors[:, 0, CLOCK] = np.where(a_receives, 0.0, -self.yaw_rate_b)
        by_errors[:, 2, BIAS] = np.isfinite(self.observations.range_m)
        by_errors[:, 2, RANGE_SCALE] = np.nan_to_num(self.observations.range_m)
        return by_errors

    def of_steps(self, yaw: FloatArray) -> FloatArray:
        """`(M - 1, 4, 7)` derivatives of each step's error (see `drifting_frames`) by the errors."""
        by_errors = np.zeros((len(yaw) - 1, 4, COUNT))
        R = se3.from_yaw(yaw[:-1], np.zeros((len(yaw) - 1, 3)))[:, :3, :3]
        by_errors[:, 1:, CLOCK] = -np.einsum("mij,mj->mi", R, np.diff(self.velocity_b, axis=0))
        by_errors[:, 1:, SCALE_A] = np.diff(self.observations.a, axis=0)
        by_errors[:, 1:, SCALE_B] = -np.einsum("mij,mj->mi", R, np.diff(self.observations.b, axis=0))
        return by_errors


@dataclass(frozen=True, eq=False)
class EstimatedErrors:
    """The seven errors with their joint covariance, and how the chain hangs on them.

    Args:
        value: `(7,)`.
        covariance: `(7, 7)`.
        prior: what was known beforehand.
        held_sigma: `(7,)` of the Gaussians that stood for the prior.
    """

    value: FloatArray
    covariance: FloatArray
    prior: ErrorPrior
    held_sigma: FloatArray

    @property
    def squared(self) -> float:
        """Sum of squares in standard deviations of the prior; a blunder counts as its rarity."""
        return self.prior.squared(self.value)

    @property
    def seldom(self) -> float:
        """The same of usual errors that are as seldom."""
        return self.prior.seldom(self.value)

    def calibrations(self, robot_a: str, robot_b: str) -> tuple[Calibration, ...]:
        """As they are reported; those that the measurements tell nothing of are left out."""
        names, sigma = _names(robot_a, robot_b), np.sqrt(np.diag(self.covariance))
        return tuple(
            Calibration(name, unit, *map(float, numbers))
            for (name, unit), *numbers in zip(names, self.value, sigma, self.prior.usual, self.held_sigma, strict=True)
        )


def _names(robot_a: str, robot_b: str) -> tuple[tuple[str, str], ...]:
    """What the seven errors are, each with its unit."""
    return (
        ("range bias", "m"),
        ("range scale error", ""),
        (f"clock of {robot_b} ahead of that of {robot_a}", "s"),
        (f"azimuth offset of {robot_a}", "rad"),
        (f"azimuth offset of {robot_b}", "rad"),
        (f"scale error of the odometry of {robot_a}", ""),
        (f"scale error of the odometry of {robot_b}", ""),
    )


def exchanged(
    calibration: Sequence[Calibration], covariance: FloatArray, robot_a: str, robot_b: str
) -> tuple[tuple[Calibration, ...], FloatArray]:
    """The seven errors and their covariance `(7, 7)` with a and b in each other's place.

    Args:
        calibration: with a as the second robot.
        covariance: of these.
        robot_a: the first robot, as it is to be.
        robot_b: the second one.
    """
    order, sign = list(_EXCHANGED), np.where(np.arange(COUNT) == CLOCK, -1.0, 1.0)
    restated = tuple(
        replace(calibration[number], name=name, value=float(direction) * calibration[number].value)
        for number, (name, _), direction in zip(order, _names(robot_a, robot_b), sign, strict=True)
    )
    return restated, np.outer(sign, sign) * covariance[np.ix_(order, order)]


def motion(trajectory: Trajectory, index: IntArray) -> tuple[FloatArray, FloatArray]:
    """Velocity `(M, 3)` and yaw rate `(M,)` at keyframes, from those before and after."""
    last = len(trajectory) - 1
    before, after = np.maximum(index - 1, 0), np.minimum(index + 1, last)
    seconds = np.maximum((trajectory.stamps_ns[after] - trajectory.stamps_ns[before]) / 1e9, 1e-3)
    moved = trajectory.positions[after] - trajectory.positions[before]
    turned = se3.wrap_angle(se3.yaw(trajectory.poses[after]) - se3.yaw(trajectory.poses[before]))
    return moved / seconds[:, None], turned / seconds
