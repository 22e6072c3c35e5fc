"""The posterior of chains of frame transforms and constant errors: how likely a guess is, and its normal equations.

Measurements pull at the blocks (yaw, w) of a chain, odometry ties each block to the next, and constant errors act on
both; see `drifting_frames`.  Many chains are looked at together, see `linear_chains`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray
from wiclosure.wiclosure_filter.config import RadioModel
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.drift.calibration import COUNT, SystematicErrors
from wiclosure.wiclosure_filter.drift.linear_chains import LinearChains, Segments
from wiclosure.wiclosure_filter.likelihood.mixture import Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations
from wiclosure.wiclosure_filter.likelihood.residuals import residual_rows, seen_by_receiver

_LEVEL = np.array([True, True, False])  # or a height would settle above or below by chance, and shift the rest
_FLOOR_M, _FLOOR_RAD = 0.05, 0.002  # a step's least error: stamps fall between keyframes


@dataclass(frozen=True, eq=False)
class ChainGuess:
    """B chains of T frame transforms together, and the constant errors of each.

    Args:
        yaw: `(T,)` relative yaw at each measurement.
        w: `(T, 3)` antenna a to antenna b in a's odometry axes.
        errors: `(B, 7)`.
    """

    yaw: FloatArray
    w: FloatArray
    errors: FloatArray

    def moved(self, blocks: FloatArray, errors: FloatArray) -> ChainGuess:
        """Blocks `(T, 4)` and errors `(B, 7)` further."""
        return ChainGuess(self.yaw + blocks[:, 0], self.w + blocks[:, 1:], self.errors + errors)


@dataclass(frozen=True, eq=False)
class StepOdometry:
    """Odometry of both robots from each measurement to the next one; the same for every guess.

    Args:
        by_a: `(M - 1, 3, 3)` axes of a in its odometry frame, where each step ends.
        by_b: the same of b.
        covariance_a: `(M - 1, 6, 6)` of a's motion, see `PairOdometry.covariance_a`.
        covariance_b: of b's.
    """

    by_a: FloatArray
    by_b: FloatArray
    covariance_a: FloatArray
    covariance_b: FloatArray

    @classmethod
    def of(cls, observations: Observations, odometry: PairOdometry) -> StepOdometry:
        """Between measurements in order of time."""
        index_a, index_b = observations.index_a, observations.index_b
        return cls(
            odometry.a.poses[index_a[1:], :3, :3],
            odometry.b.poses[index_b[1:], :3, :3],
            odometry.covariance_a(index_a[:-1], index_a[1:]),
            odometry.covariance_b(index_b[:-1], index_b[1:]),
        )

    @classmethod
    def joined(cls, parts: Sequence[StepOdometry]) -> StepOdometry:
        """Of several chains one after the other; a step from one to the next tells nothing."""
        between = cls(*(np.zeros((1, *part.shape[1:])) for part in parts[0]._arrays))
        spaced = [part for one in parts for part in (one, between)][:-1]
        return cls(*(np.concatenate(arrays) for arrays in zip(*(part._arrays for part in spaced), strict=True)))

    @property
    def _arrays(self) -> tuple[FloatArray, ...]:
        return self.by_a, self.by_b, self.covariance_a, self.covariance_b

    def covariance(self, guess: ChainGuess) -> FloatArray:
        """`(M - 1, 4, 4)` covariance of each step of (yaw, w) by odometry: drift of a and of b."""
        yaw, w = guess.yaw, guess.w
        total = np.tile(np.diag([_FLOOR_RAD**2, _FLOOR_M**2, _FLOOR_M**2, _FLOOR_M**2]), (len(w) - 1, 1, 1))
        # a's heading error turns all that a sees about a; its position error shifts it
        of_a = np.zeros((len(w) - 1, 4, 6))
        of_a[:, 0, :3] = -self.by_a[:, 2]
        of_a[:, 1:, :3] = se3.skew(w[1:]) @ self.by_a
        of_a[:, 1:, 3:] = -self.by_a
        total += se3.rotate_covariance(of_a, self.covariance_a)
        of_b = np.zeros((len(w) - 1, 4, 6))
        of_b[:, 0, :3] = self.by_b[:, 2]
        of_b[:, 1:, 3:] = se3.from_yaw(yaw[1:], np.zeros((len(w) - 1, 3)))[:, :3, :3] @ self.by_b
        return total + se3.rotate_covariance(of_b, self.covariance_b)


@dataclass(frozen=True, eq=False)
class ChainPosterior:
    """What was measured, and what was known before, of B chains of T measurements together.

    Args:
        segments: the chains.
        constant: measurements in order of time, and how they depend on the constant errors.
        radio: what is assumed of the radio.
        drift: `(T,)` and `(T,)` of position (m) and yaw (rad) that each measurement is excused for besides its noise.
        steps: odometry from each measurement to the next.
        by_height: `(T,)` information on the height at each measurement: the prior is one number, however many of them.
        by_compass: `(T,)` information of each measurement's headings.
        tells_height: `(T,)` whether a chain's measurements tell heights.
    """

    segments: Segments
    constant: SystematicErrors
    radio: RadioModel
    drift: tuple[FloatArray, FloatArray]
    steps: StepOdometry
    by_height: FloatArray
    by_compass: FloatArray
    tells_height: BoolArray

    @classmethod
    def of(
        cls,
        constant: SystematicErrors,
        radio: RadioModel,
        drift: tuple[FloatArray, FloatArray],
        prior: Prior,
        odometry: PairOdometry,
    ) -> ChainPosterior:
        """Of one chain: M measurements in order of time."""
        observations, count = constant.observations, len(constant.observations)
        return cls(
            Segments.of([count]),
            SystematicErrors.joined([constant]),
            radio,
            drift,
            StepOdometry.of(observations, odometry),
            np.full(count, prior.height_sigma_m**-2 / count),
            _yaw_information(observations, prior),
            np.full(count, observations.tells_height),
        )

    @classmethod
    def joined(cls, parts: Sequence[ChainPosterior]) -> ChainPosterior:
        """Of several chains, one each, with one radio."""
        return cls(
            Segments.of([len(part.by_height) for part in parts]),
            SystematicErrors.joined([part.constant for part in parts]),
            parts[0].radio,
            (np.concatenate([part.drift[0] for part in parts]), np.concatenate([part.drift[1] for part in parts])),
            StepOdometry.joined([part.steps for part in parts]),
            np.concatenate([part.by_height for part in parts]),
            np.concatenate([part.by_compass for part in parts]),
            np.concatenate([part.tells_height for part in parts]),
        )

    def excused(self, share: float) -> ChainPosterior:
        """With a share of the drift."""
        return replace(self, drift=(share * self.drift[0], share * self.drift[1]))

    def mixture(self, guess: ChainGuess) -> Mixture:
        """Of the measurements without the errors that are guessed; its widths are those of what was measured."""
        return replace(self._measured, observations=self.constant.corrected(guess.errors[self.segments.chain]))

    @cached_property
    def _measured(self) -> Mixture:
        return replace(Mixture.of(self.constant.observations, self.radio, self.drift), tells_height=True)

    def log_density(self, guess: ChainGuess, information: FloatArray) -> FloatArray:
        """Natural logarithms `(B,)`, up to a constant; `information (T - 1, 4, 4)` is that of the steps."""
        mixture = self.mixture(guess)
        observations = mixture.observations
        seen = seen_by_receiver(guess.w[None], guess.yaw[None], ~observations.a_receives)
        told = mixture.explain(seen).log_likelihood[0]
        return self._log_density(guess, told, _steps(guess, observations)[0], information)

    def _log_density(
        self, guess: ChainGuess, told: FloatArray, error: FloatArray, information: FloatArray
    ) -> FloatArray:
        """From what each measurement says, and the steps' errors."""
        at_each = told * self.constant.observations.independence + self.by_compass * np.cos(self._yaw - guess.yaw)
        at_each -= guess.w[:, 2] ** 2 * self.by_height / 2
        at_each[:-1] -= ((error[:, None] @ information)[:, 0] * error).sum(axis=1) / 2
        of_errors = np.sum((guess.errors / self.constant.prior_sigma) ** 2, axis=1)
        return np.asarray(self.segments.sums(at_each) - of_errors / 2)

    def linearised(self, guess: ChainGuess) -> tuple[LinearChains, FloatArray]:
        """Measurements, prior and odometry at a guess, and its log-densities `(B,)`."""
        mixture = self.mixture(guess)
        observations, constant = mixture.observations, self.constant
        rows = residual_rows(guess.w[None], guess.yaw[None], mixture)
        by_w = np.where(self.tells_height[:, None, None] | _LEVEL, rows.by_w[0], 0.0)
        weight = (rows.weight[0] * observations.independence[:, None])[..., None]
        jacobian = np.concatenate([rows.by_yaw[0][..., None], by_w], axis=-1)
        weighted = np.swapaxes(weight * jacobian, 1, 2)
        residual = rows.residual[0][..., None]
        diagonal, gradient = self._by_prior(guess)
        diagonal += weighted @ jacobian
        gradient += (weighted @ residual)[..., 0]
        border = weighted @ self._by_errors
        errors_weighted = np.swapaxes(weight * self._by_errors, 1, 2)
        of_errors = errors_weighted @ self._by_errors
        of_errors_gradient = errors_weighted @ residual
        error, back = _steps(guess, observations)
        information = (
            np.asarray(np.linalg.inv(self.steps.covariance(guess)), float) * self.segments.within[:, None, None]
        )
        coupling = np.swapaxes(back, 1, 2) @ information
        diagonal[:-1] += coupling @ back
        diagonal[1:] += information
        gradient[:-1] -= (coupling @ error[..., None])[..., 0]
        gradient[1:] -= (information @ error[..., None])[..., 0]
        of_steps = constant.of_steps(guess.yaw)
        border[:-1] += coupling @ of_steps
        border[1:] += information @ of_steps
        steps_weighted = np.swapaxes(of_steps, 1, 2) @ information
        of_errors[:-1] += steps_weighted @ of_steps
        of_errors_gradient[:-1] -= steps_weighted @ error[..., None]
        known = constant.prior_sigma**-2
        chains = LinearChains(
            self.segments,
            diagonal,
            coupling,
            gradient,
            border,
            self.segments.sums(of_errors) + known[..., None] * np.eye(COUNT),
            self.segments.sums(of_errors_gradient)[..., 0] - guess.errors * known,
            error,
            back,
            of_steps,
            information,
            observations.stamp_ns,
        )
        return chains, self._log_density(guess, rows.log_likelihood[0], error, information)

    def _by_prior(self, guess: ChainGuess) -> tuple[FloatArray, FloatArray]:
        """Information `(T, 4, 4)` and gradient `(T, 4)` of what is known of height and yaw."""
        diagonal = np.tile(1e-6 * np.eye(4), (len(guess.w), 1, 1))  # what nothing is known of still has a solution
        gradient = np.zeros((len(guess.w), 4))
        diagonal[:, 3, 3] += self.by_height
        gradient[:, 3] -= guess.w[:, 2] * self.by_height
        diagonal[:, 0, 0] += self.by_compass
        gradient[:, 0] += self.by_compass * np.sin(self._yaw - guess.yaw)
        return diagonal, gradient

    @cached_property
    def _by_errors(self) -> FloatArray:
        return self.constant.of_measured()

    @cached_property
    def _yaw(self) -> FloatArray:
        """`(T,)` by the headings; 0 where unknown."""
        return np.nan_to_num(self.constant.observations.yaw)


def _yaw_information(observations: Observations, prior: Prior) -> FloatArray:
    """`(M,)` of each measurement's headings; the prior is one number, however many of them."""
    if not np.isfinite(prior.yaw):
        return np.zeros(len(observations))
    known = np.isfinite(observations.yaw)
    return np.asarray(np.where(known, np.nan_to_num(observations.yaw_sigma, nan=1.0) ** -2, 0.0) / known.sum())


def _steps(guess: ChainGuess, observations: Observations) -> tuple[FloatArray, FloatArray]:
    """By how much each step is not what odometry tells `(M - 1, 4)`, and its derivative by the step's start."""
    yaw, w = guess.yaw, guess.w
    moved_b = np.diff(observations.b, axis=0)
    cosine, sine = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    turned = np.column_stack(
        [cosine * moved_b[:, 0] - sine * moved_b[:, 1], sine * moved_b[:, 0] + cosine * moved_b[:, 1], moved_b[:, 2]]
    )
    error = np.column_stack([np.diff(yaw), np.diff(w, axis=0) - turned + np.diff(observations.a, axis=0)])
    back = np.tile(-np.eye(4), (len(w) - 1, 1, 1))
    back[:, 1, 0], back[:, 2, 0] = turned[:, 1], -turned[:, 0]
    return error, back
