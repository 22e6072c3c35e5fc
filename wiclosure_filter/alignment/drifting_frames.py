"""The frame transform as it drifts: one local transform at each measurement, tied to the next by odometry.

A single rigid transform cannot explain measurements hundreds of metres of odometry apart.  Neighbouring measurements,
though, constrain each other tightly.  So the transform is estimated as a chain `X_1 ... X_M` along time, each described
by the relative yaw and by the displacement `w` from antenna a to antenna b in a's odometry axes, where a step adds what
odometry says that both robots moved, and both robots' drift.  Gauss-Newton on a banded system, the mixture deciding
anew which path is the direct one at every step; the drift that a rigid transform was excused for is withdrawn bit by
bit.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.alignment.calibration import CLOCK, COUNT, EstimatedErrors, SystematicErrors
from wiclosure.wiclosure_filter.alignment.chain_posterior import ChainGuess, ChainPosterior
from wiclosure.wiclosure_filter.alignment.error_prior import ErrorPrior
from wiclosure.wiclosure_filter.alignment.strain import Chain, Strain
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.likelihood.mixture import Explanation, Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations
from wiclosure.wiclosure_filter.likelihood.residuals import displacements_in_a, seen_by_receiver

_EXCUSES = (1.0, 0.5, 0.25, 0.1, 0.03, 0.0, 0.0, 0.0, 0.0)  # of the rigid transform's drift, step by step
_FEW = 4  # steps where there is nothing to be excused for
_MAX_STEP_RAD, _MAX_STEP_M = 0.3, 20.0
_SHARES = np.array([1.0, 0.3, 0.1, 0.03])  # of a step


@dataclass(frozen=True, eq=False)
class DriftingFrames:
    """The chain at its optimum.

    Args:
        yaw: `(M,)` relative yaw at each measurement.
        w: `(M, 3)` antenna a to antenna b in a's odometry axes.
        explanation: what explains each measurement there; leading dimension 1.
        middle: the measurement in the middle of the time.
        state: `(4,)` the frame transform at the middle, see `Observations`.
        covariance: `(4, 4)` of that state.
        errors: systematic errors, estimated along with the chain.
        corrected: the measurements without these errors.
        chain: the linearised chain, in order of time.
    """

    yaw: FloatArray
    w: FloatArray
    explanation: Explanation
    middle: int
    state: FloatArray
    covariance: FloatArray
    errors: EstimatedErrors
    corrected: Observations
    chain: Chain

    @cached_property
    def strain(self) -> Strain:
        """How far the measurements bend odometry and systematic errors."""
        return Strain.of(self.chain, self.errors)

    @property
    def log_mass(self) -> float:
        """Logarithm of the posterior's mass over the likelihood at its top (Laplace), up to a constant of the log."""
        return -(self.chain.squared + self.errors.squared + self.chain.system.log_determinant) / 2


def follow_drift(
    state: FloatArray,
    rigid: Mixture,
    drift: tuple[FloatArray, FloatArray],
    prior: Prior,
    odometry: PairOdometry,
    calibration: CalibrationPriors,
) -> DriftingFrames:
    """Lets a rigid transform follow the drift of both robots.

    Args:
        state: `(4,)` the rigid transform.
        rigid: the mixture that it was found with.
        drift: what that mixture allowed for, `PairOdometry.drift_from`.
        prior: on yaw and height.
        odometry: of a and b.
        calibration: how large systematic errors usually are.
    """
    order = np.argsort(rigid.observations.stamp_ns, kind="stable")
    known = ErrorPrior.of(calibration)
    constant = SystematicErrors.of(rigid.observations.subset(order), odometry, known.usual)
    posterior = ChainPosterior(constant, rigid.radio, (drift[0][order], drift[1][order]), prior, odometry)
    yaw = np.full(len(order), state[0])
    w = displacements_in_a(state[None], constant.observations)[1][0]
    at_start = rigid.subset(order).explain(seen_by_receiver(w[None], yaw[None], ~constant.observations.a_receives))
    guess = ChainGuess(yaw, w, constant.first_guess(at_start, np.linalg.norm(w, axis=1)))
    for excuse in _EXCUSES if drift_matters(drift, rigid.observations) else _EXCUSES[-_FEW:]:
        held = constant.prior_sigma
        excused = replace(posterior.excused(excuse), constant=constant)
        chain = excused.linearised(guess)
        step = chain.system.solved()
        guess = _uphill(excused, guess, (step[0].reshape(-1, 4), step[1]), chain.information)
        sigma = np.sqrt(np.diag(chain.system.covariance_of_errors()))
        constant = replace(constant, prior_sigma=known.held(guess.errors, sigma, held))
    corrected, middle, system = constant.corrected(guess.errors), len(order) // 2, chain.system
    seen = seen_by_receiver(guess.w[None], guess.yaw[None], ~corrected.a_receives)
    explanation = Mixture.of(corrected, rigid.radio).explain(seen)
    at_middle, covariance = _frame_transform(guess, middle, corrected, constant, system.marginal(middle))
    back = np.argsort(order, kind="stable")
    return DriftingFrames(
        guess.yaw[back],
        guess.w[back],
        explanation.subset(back),
        int(order[middle]),
        at_middle,
        covariance,
        EstimatedErrors(guess.errors, system.covariance_of_errors(), known, held),
        corrected.subset(back),
        chain.moved(step[0].reshape(-1, 4), step[1]),
    )


def _uphill(
    posterior: ChainPosterior, guess: ChainGuess, step: tuple[FloatArray, FloatArray], information: FloatArray
) -> ChainGuess:
    """The guess after a Gauss-Newton step of blocks `(M, 4)` and errors `(7,)`, or after as much of it as leads uphill.

    Ranges alone hold a far robot on a circle: a long step along its tangent would leave them all unexplained.
    """
    blocks, errors = step
    shrink = max(np.abs(blocks[:, 0]).max() / _MAX_STEP_RAD, np.abs(blocks[:, 1:]).max() / _MAX_STEP_M, 1.0)
    here = posterior.log_density(guess, information)
    for share in _SHARES / shrink:
        moved = guess.moved(share * blocks, share * errors)
        if posterior.log_density(moved, information) > here:
            return moved
    return guess


def drift_matters(drift: tuple[FloatArray, FloatArray], observations: Observations) -> bool:
    """False where a rigid transform explains everything as well."""
    relative = drift[0].max() / observations.typical_distance_m
    ranged = np.isfinite(observations.range_m)
    bent = (drift[0][ranged] > observations.range_sigma_m[ranged]).any()
    return bool(bent or relative > 0.02 or drift[1].max() > 0.02)


def _frame_transform(
    guess: ChainGuess, at: int, observations: Observations, constant: SystematicErrors, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """State and covariance of the frame transform from (yaw, w) at one measurement and the constant errors."""
    yaw, w, a, b = guess.yaw[at], guess.w[at], observations.a[at], observations.b[at]
    R = se3.from_yaw(yaw, np.zeros(3))[:3, :3]
    turned = R @ b
    by_local = np.eye(4, 4 + COUNT)
    by_local[1, 0], by_local[2, 0] = turned[1], -turned[0]
    by_local[1:, 4 + CLOCK] = -R @ constant.velocity_b[at]  # b was elsewhere when it was heard
    return np.concatenate([[se3.wrap_angle(np.asarray(yaw))], w + a - turned]), se3.rotate_covariance(
        by_local, covariance
    )
