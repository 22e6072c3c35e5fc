"""The frame transform as it drifts: one local transform at each measurement, tied to the next by odometry.

A single rigid transform cannot explain measurements hundreds of metres of odometry apart.  Neighbouring measurements,
though, constrain each other tightly.  So the transform is estimated as a chain `X_1 ... X_M` along time, each described
by the relative yaw and by the displacement `w` from antenna a to antenna b in a's odometry axes, where a step adds what
odometry says that both robots moved, and both robots' drift.  Gauss-Newton on a banded system, the mixture deciding
anew which path is the direct one at every step; the drift that a rigid transform was excused for is withdrawn bit by
bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Prior, displacement_m
from wiclosure.wiclosure_filter.drift.calibration import CLOCK, COUNT, EstimatedErrors, SystematicErrors
from wiclosure.wiclosure_filter.drift.chain_posterior import ChainGuess, ChainPosterior
from wiclosure.wiclosure_filter.drift.error_prior import ErrorPrior
from wiclosure.wiclosure_filter.drift.linear_chains import LinearChains
from wiclosure.wiclosure_filter.drift.strain import Chain, Strain
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
        covariance_with_errors: `(4, 7)` of that state with the systematic errors.
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
    covariance_with_errors: FloatArray
    errors: EstimatedErrors
    corrected: Observations
    chain: Chain

    @cached_property
    def strain(self) -> Strain:
        """How far the measurements bend odometry and systematic errors."""
        return Strain.of(self.chain, self.errors)

    def apart_m(self, error: int, value: float) -> float:
        """How far b's path would be from here if a systematic error had another value (root mean square)."""
        by_error = self.covariance_with_errors[:, error] / self.errors.covariance[error, error]
        other = self.state + by_error * (value - self.errors.value[error])
        return float(displacement_m(other, self.state, self.corrected))

    @property
    def log_mass(self) -> float:
        """Logarithm of the posterior's mass over the likelihood at its top (Laplace), up to a constant of the log."""
        return -(self.chain.squared + self.errors.squared + self.chain.system.log_determinant) / 2


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """A rigid transform between two robots, from where the drift is followed.

    Args:
        state: `(4,)` the transform.
        mixture: that it was found with.
        drift: what that mixture allowed for, `PairOdometry.drift_from`.
        prior: on yaw and height.
        odometry: of a and b.
        calibration: how large systematic errors usually are.
    """

    state: FloatArray
    mixture: Mixture
    drift: tuple[FloatArray, FloatArray]
    prior: Prior
    odometry: PairOdometry
    calibration: CalibrationPriors

    @property
    def known(self) -> ErrorPrior:
        """Of constant errors."""
        return ErrorPrior.of(self.calibration)

    @cached_property
    def order(self) -> IntArray:
        """`(M,)` measurements in order of time."""
        return np.argsort(self.mixture.observations.stamp_ns, kind="stable")

    @cached_property
    def constant(self) -> SystematicErrors:
        """The measurements in order of time, as constant errors change them."""
        return SystematicErrors.of(self.mixture.observations.subset(self.order), self.odometry, self.known.usual)

    @cached_property
    def drift_matters(self) -> bool:
        """See there."""
        return drift_matters(self.drift, self.mixture.observations)

    def posterior(self) -> ChainPosterior:
        """Of its chain."""
        drift = self.drift[0][self.order], self.drift[1][self.order]
        return ChainPosterior.of(self.constant, self.mixture.radio, drift, self.prior, self.odometry)

    def first_guess(self) -> ChainGuess:
        """The same transform at every measurement."""
        observations = self.constant.observations
        yaw = np.full(len(self.order), self.state[0])
        w = displacements_in_a(self.state[None], observations)[1][0]
        seen = seen_by_receiver(w[None], yaw[None], ~observations.a_receives)
        at_start = self.mixture.subset(self.order).explain(seen)
        return ChainGuess(yaw, w, self.constant.first_guess(at_start, np.linalg.norm(w, axis=1))[None])


def follow_drifts(rigid: Sequence[RigidTransform]) -> list[DriftingFrames | None]:
    """Lets rigid transforms follow both robots' drift, together; None where steps leave no digits for the rest."""
    found: list[DriftingFrames | None] = [None] * len(rigid)
    matters = [one.drift_matters for one in rigid]
    for drifting in (True, False):
        rows = [row for row, one in enumerate(matters) if one == drifting]
        for row, frames in zip(rows, _together([rigid[row] for row in rows]), strict=True):
            found[row] = frames
    return found


def _together(rigid: Sequence[RigidTransform]) -> list[DriftingFrames | None]:
    if not rigid:
        return []
    try:
        return [*_climbed(rigid)]
    except np.linalg.LinAlgError:
        return [None] if len(rigid) == 1 else [frames for one in rigid for frames in _together([one])]


def _climbed(rigid: Sequence[RigidTransform]) -> list[DriftingFrames]:
    """Of transforms for which drift matters, or of such for which it does not."""
    posterior = ChainPosterior.joined([one.posterior() for one in rigid])
    guesses = [one.first_guess() for one in rigid]
    guess = ChainGuess(
        *(np.concatenate(parts) for parts in zip(*((g.yaw, g.w, g.errors) for g in guesses), strict=True))
    )
    known, constant = rigid[0].known, posterior.constant
    for excuse in _EXCUSES if rigid[0].drift_matters else _EXCUSES[-_FEW:]:
        held = constant.prior_sigma
        excused = replace(posterior.excused(excuse), constant=constant)
        chains, here = excused.linearised(guess)
        step = chains.solved()
        guess = _uphill(excused, guess, here, step, chains.information)
        sigma = np.sqrt(np.diagonal(chains.covariance_of_errors, axis1=1, axis2=2))
        constant = replace(constant, prior_sigma=known.held(guess.errors, sigma, held))
    return [_frames(one, guess, step, chains, number, held[number]) for number, one in enumerate(rigid)]


def _frames(
    rigid: RigidTransform,
    guess: ChainGuess,
    step: tuple[FloatArray, FloatArray],
    chains: LinearChains,
    number: int,
    held: FloatArray,
) -> DriftingFrames:
    """One of the chains, of which errors were held by Gaussians of sigma `held (7,)`."""
    constant, order, errors = rigid.constant, rigid.order, guess.errors[number]
    rows = slice(*chains.segments.ends[number : number + 2])
    yaw, w, chain = guess.yaw[rows], guess.w[rows], chains.chain(number)
    corrected, middle, system = constant.corrected(errors), len(order) // 2, chain.system
    explanation = Mixture.of(corrected, rigid.mixture.radio).explain(
        seen_by_receiver(w[None], yaw[None], ~corrected.a_receives)
    )
    own = ChainGuess(yaw, w, errors)
    at_middle, joint = _frame_transform(own, middle, corrected, constant, system.marginal(middle))
    back = np.argsort(order, kind="stable")
    return DriftingFrames(
        yaw[back],
        w[back],
        explanation.subset(back),
        int(order[middle]),
        at_middle,
        joint[:4, :4],
        joint[:4, 4:],
        EstimatedErrors(errors, system.covariance_of_errors(), rigid.known, held),
        corrected.subset(back),
        chain.moved(step[0][rows], step[1][number]),
    )


def _uphill(
    posterior: ChainPosterior,
    guess: ChainGuess,
    here: FloatArray,
    step: tuple[FloatArray, FloatArray],
    information: FloatArray,
) -> ChainGuess:
    """The guess after a Gauss-Newton step, or in each chain after as much of it as leads uphill.

    Ranges alone hold a far robot on a circle: a long step along its tangent would leave them all unexplained.

    Args:
        posterior: of B chains.
        guess: where they are.
        here: `(B,)` log-densities of that.
        step: blocks `(T, 4)` and errors `(B, 7)`.
        information: of the odometry's steps.
    """
    blocks, errors = step
    long = posterior.segments.largest(np.abs(blocks) / [_MAX_STEP_RAD, _MAX_STEP_M, _MAX_STEP_M, _MAX_STEP_M])
    taken = np.zeros(len(errors))

    def moved(shares: FloatArray) -> ChainGuess:
        return guess.moved(shares[posterior.segments.chain][:, None] * blocks, shares[:, None] * errors)

    for share in _SHARES:
        tried = np.where(taken > 0, 0.0, share / np.maximum(long, 1.0))
        if not tried.any():
            break
        higher = posterior.log_density(moved(tried), information) > here
        taken = np.where(higher & (tried > 0), tried, taken)
    return moved(taken)


def drift_matters(drift: tuple[FloatArray, FloatArray], observations: Observations) -> bool:
    """False where a rigid transform explains everything as well."""
    relative = drift[0].max() / observations.typical_distance_m
    ranged = np.isfinite(observations.range_m)
    bent = (drift[0][ranged] > observations.range_sigma_m[ranged]).any()
    return bool(bent or relative > 0.02 or drift[1].max() > 0.02)


def _frame_transform(
    guess: ChainGuess, at: int, observations: Observations, constant: SystematicErrors, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """State of the frame transform from (yaw, w) at one measurement, and its covariance with the constant errors."""
    yaw, w, a, b = guess.yaw[at], guess.w[at], observations.a[at], observations.b[at]
    R = se3.from_yaw(yaw, np.zeros(3))[:3, :3]
    turned = R @ b
    by_local = np.eye(4 + COUNT)
    by_local[1, 0], by_local[2, 0] = turned[1], -turned[0]
    by_local[1:4, 4 + CLOCK] = -R @ constant.velocity_b[at]  # b was elsewhere when it was heard
    return np.concatenate([[se3.wrap_angle(np.asarray(yaw))], w + a - turned]), se3.rotate_covariance(
        by_local, covariance
    )
