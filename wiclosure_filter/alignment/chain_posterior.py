"""The posterior of a chain of frame transforms and constant errors: how likely a guess is, and its normal equations.

Measurements pull at the blocks (yaw, w) of the chain, odometry ties each block to the next, and constant errors act on
both; see `drifting_frames`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.alignment.bordered_system import BorderedSystem
from wiclosure.wiclosure_filter.alignment.calibration import SystematicErrors
from wiclosure.wiclosure_filter.alignment.strain import Chain
from wiclosure.wiclosure_filter.config import RadioModel
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.likelihood.mixture import Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations
from wiclosure.wiclosure_filter.likelihood.residuals import residual_rows, seen_by_receiver

_FLOOR_M, _FLOOR_RAD = 0.05, 0.002  # a step's least error: stamps fall between keyframes


@dataclass(frozen=True, eq=False)
class ChainGuess:
    """A chain of M frame transforms, and the constant errors.

    Args:
        yaw: `(M,)` relative yaw at each measurement.
        w: `(M, 3)` antenna a to antenna b in a's odometry axes.
        errors: `(7,)`.
    """

    yaw: FloatArray
    w: FloatArray
    errors: FloatArray

    def moved(self, blocks: FloatArray, errors: FloatArray) -> ChainGuess:
        """Blocks `(M, 4)` and errors `(7,)` further."""
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
    """What was measured, and what was known before.

    Args:
        constant: measurements in order of time, and how they depend on the constant errors.
        radio: what is assumed of the radio.
        drift: `(M,)` and `(M,)` of position (m) and yaw (rad) that each measurement is excused for besides its noise.
        prior: on yaw and height.
        steps: odometry from each measurement to the next.
    """

    constant: SystematicErrors
    radio: RadioModel
    drift: tuple[FloatArray, FloatArray]
    prior: Prior
    steps: StepOdometry

    def excused(self, share: float) -> ChainPosterior:
        """With a share of the drift."""
        return replace(self, drift=(share * self.drift[0], share * self.drift[1]))

    def mixture(self, guess: ChainGuess) -> Mixture:
        """Of the measurements without the errors that are guessed; its widths are those of what was measured."""
        return replace(self._measured, observations=self.constant.corrected(guess.errors))

    @cached_property
    def _measured(self) -> Mixture:
        return Mixture.of(self.constant.observations, self.radio, self.drift)

    def log_density(self, guess: ChainGuess, information: FloatArray) -> float:
        """Natural logarithm, up to a constant; `information (M - 1, 4, 4)` is that of the steps."""
        mixture = self.mixture(guess)
        observations = mixture.observations
        seen = seen_by_receiver(guess.w[None], guess.yaw[None], ~observations.a_receives)
        told = mixture.explain(seen).log_likelihood[0] @ observations.independence
        return self._log_density(guess, told, _steps(guess, observations)[0], information)

    def _log_density(self, guess: ChainGuess, told: float, error: FloatArray, information: FloatArray) -> float:
        """From what the measurements say, and the steps' errors."""
        squared = np.einsum("mi,mi->", (error[:, None] @ information)[:, 0], error)
        squared += np.sum((guess.errors / self.constant.prior_sigma) ** 2)
        squared += np.mean(guess.w[:, 2] ** 2) / self.prior.height_sigma_m**2
        by_compass = self._yaw_information @ np.cos(self._yaw - guess.yaw)
        return float(told + by_compass - squared / 2)

    def linearised(self, guess: ChainGuess) -> tuple[Chain, float]:
        """Measurements, prior and odometry at a guess, and its log-density."""
        mixture = self.mixture(guess)
        observations, constant = mixture.observations, self.constant
        rows = residual_rows(guess.w[None], guess.yaw[None], mixture)
        weight = (rows.weight[0] * observations.independence[:, None])[..., None]
        jacobian = np.concatenate([rows.by_yaw[0][..., None], rows.by_w[0]], axis=-1)
        weighted = np.swapaxes(weight * jacobian, 1, 2)
        diagonal, gradient = self._by_prior(guess)
        diagonal += weighted @ jacobian
        gradient += np.einsum("mir,mr->mi", weighted, rows.residual[0])
        by_errors = constant.of_measured()
        border = weighted @ by_errors
        of_errors = np.einsum("mri,mrj->ij", weight * by_errors, by_errors) + np.diag(constant.prior_sigma**-2)
        gradient_of_errors = np.einsum("mri,mr->i", weight * by_errors, rows.residual[0])
        gradient_of_errors -= guess.errors / constant.prior_sigma**2
        error, back = _steps(guess, observations)
        information = np.asarray(np.linalg.inv(self.steps.covariance(guess)), float)
        coupling = np.swapaxes(back, 1, 2) @ information
        diagonal[:-1] += coupling @ back
        diagonal[1:] += information
        gradient[:-1] -= np.einsum("mij,mj->mi", coupling, error)
        gradient[1:] -= np.einsum("mij,mj->mi", information, error)
        of_steps = constant.of_steps(guess.yaw)
        border[:-1] += coupling @ of_steps
        border[1:] += information @ of_steps
        steps_weighted = np.swapaxes(of_steps, 1, 2) @ information
        of_errors += (steps_weighted @ of_steps).sum(axis=0)
        gradient_of_errors -= np.einsum("mij,mj->i", steps_weighted, error)
        system = BorderedSystem(diagonal, coupling, gradient, border, of_errors, gradient_of_errors)
        told = rows.log_likelihood[0] @ observations.independence
        chain = Chain(system, error, back, of_steps, information, observations.stamp_ns)
        return chain, self._log_density(guess, told, error, information)

    def _by_prior(self, guess: ChainGuess) -> tuple[FloatArray, FloatArray]:
        """Information `(M, 4, 4)` and gradient `(M, 4)` of what is known of height and yaw."""
        count, height = len(guess.w), self.prior.height_sigma_m**-2
        diagonal = np.tile(1e-6 * np.eye(4), (count, 1, 1))  # what nothing is known of still has a solution
        gradient = np.zeros((count, 4))
        diagonal[:, 3, 3] += height / count  # the prior is one number, however many measurements
        gradient[:, 3] -= guess.w[:, 2] * height / count
        diagonal[:, 0, 0] += self._yaw_information
        gradient[:, 0] += self._yaw_information * np.sin(self._yaw - guess.yaw)
        return diagonal, gradient

    @cached_property
    def _yaw(self) -> FloatArray:
        """`(M,)` by the headings; 0 where unknown."""
        return np.nan_to_num(self.constant.observations.yaw)

    @cached_property
    def _yaw_information(self) -> FloatArray:
        """`(M,)` of each measurement's headings; the prior is one number, however many of them."""
        observations = self.constant.observations
        if not np.isfinite(self.prior.yaw):
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
