"""A peak of the likelihood, followed through the drift of both robots: what is reported, and what speaks against it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, Calibration, FloatArray, IntArray
from wiclosure.wiclosure_filter.alignment.ambiguity import unobservable
from wiclosure.wiclosure_filter.config import AmbiguitySettings, CalibrationPriors
from wiclosure.wiclosure_filter.consensus.consensus import AnchoredPeaks
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry
from wiclosure.wiclosure_filter.drift.calibration import CONSTANT_BLUNDER, RANGE_SCALE
from wiclosure.wiclosure_filter.drift.drifting_frames import DriftingFrames, RigidTransform
from wiclosure.wiclosure_filter.likelihood.fit import Fit
from wiclosure.wiclosure_filter.likelihood.mixture import MIN_DISTANCE_M, Explanation, Mixture
from wiclosure.wiclosure_filter.likelihood.observations import LEVEL_SIGMA_RAD, Observations
from wiclosure.wiclosure_filter.likelihood.residuals import displacements_in_a, explained
from wiclosure.wiclosure_filter.links.links import Links

_BEYOND_SIGMA = 3.0  # of the covariance that is stated


@dataclass(frozen=True, eq=False)
class Followed:
    """A peak, followed through the drift of both robots where that matters.

    Args:
        hypothesis: as it is reported.
        covariance: `(6, 6)`.
        mixture: likelihood of the measurements, without the drift that was followed.
        explanation: of the measurements; leading dimension 1.
        distance_m: `(M,)` of the antennas.
        frames: the chain that follows the drift; None where nothing was to follow.
        log_evidence: natural logarithm of the posterior's mass, up to a constant of the log; NaN without frames.
        vague: why it is too vague to prune by, or an empty string.
        calibration: systematic errors that were estimated along with it.
    """

    hypothesis: AlignmentHypothesis
    covariance: FloatArray
    mixture: Mixture
    explanation: Explanation
    distance_m: FloatArray
    frames: DriftingFrames | None = None
    log_evidence: float = np.nan
    vague: str = ""
    calibration: tuple[Calibration, ...] = ()

    @property
    def fit(self) -> Fit:
        """How well it explains the measurements."""
        return Fit.of(self.mixture, self.explanation, self.distance_m)

    def apart_m(self, other: Followed) -> float:
        """How far it puts b from where another one does, horizontally (root mean square); 0 without frames."""
        if self.frames is None or other.frames is None:
            return 0.0
        return float(np.sqrt(np.mean(np.sum((self.frames.w - other.frames.w)[:, :2] ** 2, axis=1))))

    def differs(self, other: Followed, same_place_m: float) -> bool:
        """Whether another one puts b elsewhere: so far, or beyond three sigma of this one, which stands for no twin."""
        if self.frames is None or other.frames is None:
            return False
        off = other.frames.state - self.frames.state
        off[0] = se3.wrap_angle(off[0])
        squared = off @ np.linalg.solve(self.frames.covariance, off)
        return bool(self.apart_m(other) > same_place_m or squared > _BEYOND_SIGMA**2)

    @property
    def bent_ns(self) -> tuple[int, int] | None:
        """When the measurements bend the odometry most."""
        return None if self.frames is None else self.frames.strain.bent_ns

    def slip(self, min_odds: float) -> str:
        """Why the odometry seems to slip, or an empty string."""
        return "" if self.frames is None else self.frames.strain.slip(min_odds)

    def strain_probability(self, inflation: float) -> float:
        """That odometry and systematic errors of their usual size are bent as far."""
        return 1.0 if self.frames is None else self.frames.strain.probability(inflation)

    def overstrained(self, min_probability: float) -> str:
        """That odometry, with the errors it is granted, would hardly be bent as far: a sentence, or empty."""
        probability = 1.0 if self.frames is None else self.frames.strain.honest_probability
        if probability >= min_probability:
            return ""
        return (
            "the measurements fit only if odometry and constant errors are bent further than usual ones are"
            f" (probability {probability:.0e})"
        )

    def extraordinary(self, guard: AmbiguitySettings) -> str:
        """Systematic errors that are far larger than usual: a sentence, or empty.

        Or that may be, where this would put b elsewhere: what moves it by less is in the covariance.
        """
        same_place_m = guard.same_place_fraction * self.mixture.observations.typical_distance_m
        beyond = [
            str(error)
            for number, error in enumerate(self.calibration)
            if error.extraordinary
            or (
                number != RANGE_SCALE
                and error.log_blunder > -np.log(guard.min_odds * CONSTANT_BLUNDER)
                and self.frames is not None
                and self.frames.apart_m(number, error.as_blunder) > same_place_m
            )
        ]
        return f"the measurements tell a systematic error beyond the usual: {'; '.join(beyond)}" if beyond else ""


def rigid_transform(
    found: AnchoredPeaks, row: int, odometry: PairOdometry, calibration: CalibrationPriors
) -> RigidTransform:
    """A peak, from where drift can be followed; see `follow`."""
    return RigidTransform(found.peaks.states[row], found.mixture, found.drift, found.prior, odometry, calibration)


def follow(
    found: AnchoredPeaks,
    row: int,
    links: Links,
    frames: DriftingFrames | None,
    covariance: FloatArray,
    guard: AmbiguitySettings,
) -> Followed:
    """A peak that was followed through the drift of both robots, or as it is.

    Args:
        found: all peaks.
        row: which of them.
        links: the measurements.
        frames: the chain that follows the drift, see `rigid_transform`; None where nothing was to follow.
        covariance: `(4, 4)` of the best peak with its neighbours.
        guard: when it is too vague.
    """
    mixture, observations = found.mixture, found.mixture.observations
    state, explanation = found.peaks.states[row], explained(found.peaks.states[row], mixture)
    w = displacements_in_a(state[None], observations)[1][0]
    vague = ""
    calibration: tuple[Calibration, ...] = ()
    if frames is not None:
        state, explanation, w = frames.state, frames.explanation, frames.w
        covariance = frames.covariance + _spread(covariance, found.peaks.information[row])
        mixture = Mixture.of(frames.corrected, mixture.radio)
        calibration = frames.errors.calibrations(links.robot_a, links.robot_b)
        vague = unobservable(covariance, observations, guard)
    hypothesis = AlignmentHypothesis(
        T_a_b=observations.frame_transform(state),
        log_likelihood=float(explanation.log_likelihood[0] @ observations.independence),
        paths_kept=paths_kept(explanation, links, None if found.chosen is None else found.chosen[row]),
    )
    log_evidence = hypothesis.log_likelihood + float(found.prior.log_density(state[None])[0])
    log_evidence += np.nan if frames is None else frames.log_mass
    distance_m = np.maximum(np.linalg.norm(w, axis=1), MIN_DISTANCE_M)
    covariance = tangent_covariance(state, covariance, observations)
    return Followed(hypothesis, covariance, mixture, explanation, distance_m, frames, log_evidence, vague, calibration)


def _spread(covariance: FloatArray, information: FloatArray) -> FloatArray:
    """What peaks near the best one add to its covariance `(4, 4)`."""
    alone = np.linalg.inv(information + 1e-9 * np.trace(information) * np.eye(4))
    values, vectors = np.linalg.eigh(covariance - alone)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def paths_kept(explanation: Explanation, links: Links, chosen: IntArray | None) -> tuple[tuple[int, int], ...]:
    """The direct path of each measurement, -1 for a range without one; as `chosen (M,)` by a method, or most likely."""
    direct = explanation.direct() if chosen is None else chosen
    ranged = explanation.ranged() & links.has_range if chosen is None else direct >= 0
    kept = (direct >= 0) | ranged
    path = np.where(direct >= 0, links.path[np.arange(len(links)), direct], -1)
    return tuple((int(m), int(k)) for m, k in zip(links.measurement[kept], path[kept], strict=True))


def tangent_covariance(state: FloatArray, covariance: FloatArray, observations: Observations) -> FloatArray:
    """`(6, 6)` of a frame transform, as errors in b's odometry frame (see `wiclosure.se3`), from that of its state."""
    T_a_b = observations.frame_transform(state)
    to_tangent = np.zeros((6, 4))  # d(yaw, centre's place in a) -> [rotation, translation] in b's odometry axes
    to_tangent[2, 0] = 1.0
    to_tangent[3:, 0] = -np.cross([0.0, 0.0, 1.0], observations.centre_b)
    to_tangent[3:, 1:] = T_a_b[:3, :3].T
    level = np.diag([LEVEL_SIGMA_RAD**2, LEVEL_SIGMA_RAD**2, 0.0, 0.0, 0.0, 0.0])
    return np.asarray(to_tangent @ covariance @ to_tangent.T + level)
