"""The frame transform as it drifts: one local transform at each measurement, tied to the next by odometry.

A single rigid transform cannot explain measurements hundreds of metres of odometry apart.  Neighbouring measurements,
though, constrain each other tightly.  So the transform is estimated as a chain `X_1 ... X_M` along time, each described
by the relative yaw and by the displacement `w` from antenna a to antenna b in a's odometry axes, where a step adds what
odometry says that both robots moved, and both robots' drift.  Gauss-Newton on a banded system, the mixture deciding
anew which path is the direct one at every step; the drift that a rigid transform was excused for is withdrawn bit by
bit.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.alignment.bordered_system import BorderedSystem
from wiclosure.wiclosure_filter.alignment.calibration import CLOCK, COUNT, EstimatedErrors, SystematicErrors
from wiclosure.wiclosure_filter.alignment.strain import Chain, Strain
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.consensus.refinement import Prior
from wiclosure.wiclosure_filter.likelihood.mixture import Explanation, Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations
from wiclosure.wiclosure_filter.likelihood.residuals import (
    ResidualRows,
    displacements_in_a,
    residual_rows,
    seen_by_receiver,
)

_EXCUSES = (1.0, 0.5, 0.25, 0.1, 0.03, 0.0, 0.0, 0.0, 0.0)  # of the rigid transform's drift, step by step
_FEW = 4  # steps where there is nothing to be excused for
_FLOOR_M, _FLOOR_RAD = 0.05, 0.002  # a step's least error: stamps fall between keyframes
_MAX_STEP_RAD, _MAX_STEP_M = 0.3, 20.0


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
    errors = SystematicErrors.of(rigid.observations.subset(order), odometry, calibration)
    excused = (drift[0][order], drift[1][order])
    yaw = np.full(len(order), state[0])
    w = displacements_in_a(state[None], errors.observations)[1][0]
    at_start = rigid.subset(order).explain(seen_by_receiver(w[None], yaw[None], ~errors.observations.a_receives))
    value = errors.first_guess(at_start, np.linalg.norm(w, axis=1))
    for excuse in _EXCUSES if drift_matters(drift, rigid.observations) else _EXCUSES[-_FEW:]:
        links = errors.corrected(value)
        mixture = Mixture.of(links, rigid.radio, (excuse * excused[0], excuse * excused[1]) if excuse > 0 else None)
        system = _system(yaw, w, mixture, prior, odometry, errors, value)
        step, by_errors = system.solved()
        step = step.reshape(-1, 4)
        linearised_at = yaw, w, links
        shrink = max(np.abs(step[:, 0]).max() / _MAX_STEP_RAD, np.abs(step[:, 1:]).max() / _MAX_STEP_M, 1.0)
        yaw, w, value = yaw + step[:, 0] / shrink, w + step[:, 1:] / shrink, value + by_errors / shrink
    chain = _chain(*linearised_at, odometry, errors, system).moved(step, by_errors)
    links = errors.corrected(value)
    mixture = Mixture.of(links, rigid.radio)
    explanation = mixture.explain(seen_by_receiver(w[None], yaw[None], ~links.a_receives))
    middle = len(links) // 2
    at_middle, covariance = _frame_transform(
        yaw[middle], w[middle], links.a[middle], links.b[middle], errors.velocity_b[middle], system.marginal(middle)
    )
    back = np.argsort(order, kind="stable")
    estimated = EstimatedErrors(value, system.covariance_of_errors(), errors.prior_sigma)
    return DriftingFrames(
        yaw[back],
        w[back],
        explanation.subset(back),
        int(order[middle]),
        at_middle,
        covariance,
        estimated,
        links.subset(back),
        chain,
    )


def drift_matters(drift: tuple[FloatArray, FloatArray], observations: Observations) -> bool:
    """False where a rigid transform explains everything as well."""
    relative = drift[0].max() / observations.typical_distance_m
    return bool(relative > 0.02 or drift[1].max() > 0.02)


def _system(
    yaw: FloatArray,
    w: FloatArray,
    mixture: Mixture,
    prior: Prior,
    odometry: PairOdometry,
    errors: SystematicErrors,
    value: FloatArray,
) -> BorderedSystem:
    """Linearises measurements, prior and odometry at the current chain and systematic errors."""
    observations = mixture.observations
    rows = residual_rows(w[None], yaw[None], mixture)
    weight = (rows.weight[0] * observations.independence[:, None])[..., None]
    jacobian = np.concatenate([rows.by_yaw[0][..., None], rows.by_w[0]], axis=-1)
    diagonal, gradient = _measured(yaw, w, rows, mixture, prior)
    by_errors = errors.of_measured()
    border = np.swapaxes(weight * jacobian, 1, 2) @ by_errors
    of_errors = np.einsum("mri,mrj->ij", weight * by_errors, by_errors) + np.diag(errors.prior_sigma**-2)
    gradient_of_errors = np.einsum("mri,mr->i", weight * by_errors, rows.residual[0]) - value / errors.prior_sigma**2
    error, back = _steps(yaw, w, observations)
    information = np.linalg.inv(_step_covariance(yaw, w, observations, odometry))
    coupling = np.swapaxes(back, 1, 2) @ information
    diagonal[:-1] += coupling @ back
    diagonal[1:] += information
    gradient[:-1] -= np.einsum("mij,mj->mi", coupling, error)
    gradient[1:] -= np.einsum("mij,mj->mi", information, error)
    of_steps = errors.of_steps(yaw)
    border[:-1] += coupling @ of_steps
    border[1:] += information @ of_steps
    weighted = np.swapaxes(of_steps, 1, 2) @ information
    of_errors += (weighted @ of_steps).sum(axis=0)
    gradient_of_errors -= np.einsum("mij,mj->i", weighted, error)
    return BorderedSystem(diagonal, coupling, gradient, border, of_errors, gradient_of_errors)


def _chain(
    yaw: FloatArray,
    w: FloatArray,
    observations: Observations,
    odometry: PairOdometry,
    errors: SystematicErrors,
    system: BorderedSystem,
) -> Chain:
    error, by_start = _steps(yaw, w, observations)
    information = np.asarray(np.linalg.inv(_step_covariance(yaw, w, observations, odometry)), float)
    return Chain(system, error, by_start, errors.of_steps(yaw), information, observations.stamp_ns)


def _measured(
    yaw: FloatArray, w: FloatArray, rows: ResidualRows, mixture: Mixture, prior: Prior
) -> tuple[FloatArray, FloatArray]:
    """Information `(M, 4, 4)` and gradient `(M, 4)` of measurements and prior."""
    observations = mixture.observations
    jacobian = np.concatenate([rows.by_yaw[0][..., None], rows.by_w[0]], axis=-1)
    weighted = (rows.weight[0] * observations.independence[:, None])[..., None] * jacobian
    diagonal = np.swapaxes(weighted, 1, 2) @ jacobian
    gradient = np.einsum("mri,mr->mi", weighted, rows.residual[0])
    count = len(w)
    diagonal[:, 3, 3] += prior.height_sigma_m**-2 / count  # the prior is one number, however many measurements
    gradient[:, 3] -= w[:, 2] * prior.height_sigma_m**-2 / count
    if np.isfinite(prior.yaw):
        known = np.isfinite(observations.yaw)
        information = np.where(known, np.nan_to_num(observations.yaw_sigma, nan=1.0) ** -2, 0.0) / known.sum()
        diagonal[:, 0, 0] += information
        gradient[:, 0] += information * np.sin(np.nan_to_num(observations.yaw) - yaw)
    diagonal += 1e-6 * np.eye(4)  # what nothing is known of still has a solution
    return diagonal, gradient


def _steps(yaw: FloatArray, w: FloatArray, observations: Observations) -> tuple[FloatArray, FloatArray]:
    """By how much each step is not what odometry tells `(M - 1, 4)`, and its derivative by the step's start."""
    moved_b = np.diff(observations.b, axis=0)
    cosine, sine = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    turned = np.column_stack(
        [cosine * moved_b[:, 0] - sine * moved_b[:, 1], sine * moved_b[:, 0] + cosine * moved_b[:, 1], moved_b[:, 2]]
    )
    error = np.column_stack([np.diff(yaw), np.diff(w, axis=0) - turned + np.diff(observations.a, axis=0)])
    back = np.tile(-np.eye(4), (len(w) - 1, 1, 1))
    back[:, 1, 0], back[:, 2, 0] = turned[:, 1], -turned[:, 0]
    return error, back


def _step_covariance(yaw: FloatArray, w: FloatArray, observations: Observations, odometry: PairOdometry) -> FloatArray:
    """`(M - 1, 4, 4)` covariance of each step of (yaw, w) by odometry: drift of a and of b."""
    total = np.tile(np.diag([_FLOOR_RAD**2, _FLOOR_M**2, _FLOOR_M**2, _FLOOR_M**2]), (len(w) - 1, 1, 1))
    index_a, index_b = observations.index_a, observations.index_b
    # a's heading error turns all that a sees about a; its position error shifts it
    R_odom_body = odometry.a.poses[index_a[1:], :3, :3]
    of_a = np.zeros((len(w) - 1, 4, 6))
    of_a[:, 0, :3] = -R_odom_body[:, 2]
    of_a[:, 1:, :3] = se3.skew(w[1:]) @ R_odom_body
    of_a[:, 1:, 3:] = -R_odom_body
    total += se3.rotate_covariance(of_a, odometry.covariance_a(index_a[:-1], index_a[1:]))
    R_odom_body = odometry.b.poses[index_b[1:], :3, :3]
    of_b = np.zeros((len(w) - 1, 4, 6))
    of_b[:, 0, :3] = R_odom_body[:, 2]
    of_b[:, 1:, 3:] = se3.from_yaw(yaw[1:], np.zeros((len(w) - 1, 3)))[:, :3, :3] @ R_odom_body
    return total + se3.rotate_covariance(of_b, odometry.covariance_b(index_b[:-1], index_b[1:]))


def _frame_transform(
    yaw: float, w: FloatArray, a: FloatArray, b: FloatArray, velocity_b: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """State and covariance of the frame transform from (yaw, w) at one measurement and the systematic errors."""
    R = se3.from_yaw(yaw, np.zeros(3))[:3, :3]
    turned = R @ b
    by_local = np.eye(4, 4 + COUNT)
    by_local[1, 0], by_local[2, 0] = turned[1], -turned[0]
    by_local[1:, 4 + CLOCK] = -R @ velocity_b  # b was elsewhere when it was heard
    return np.concatenate([[se3.wrap_angle(np.asarray(yaw))], w + a - turned]), se3.rotate_covariance(
        by_local, covariance
    )
