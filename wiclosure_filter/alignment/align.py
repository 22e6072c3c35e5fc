"""How the odometry frames of two robots lie, from their links; or a sentence on why the links do not tell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, Calibration, FloatArray, FrameAlignment, IntArray, Trajectory
from wiclosure.wiclosure_filter.alignment.ambiguity import Selection, assess, unobservable
from wiclosure.wiclosure_filter.alignment.calibration import CONSTANT_BLUNDER, RANGE_SCALE
from wiclosure.wiclosure_filter.alignment.drifting_frames import DriftingFrames, drift_matters, follow_drift
from wiclosure.wiclosure_filter.alignment.indistinguishable import Blunders
from wiclosure.wiclosure_filter.alignment.second_alignment import SecondAlignment, second_alignment
from wiclosure.wiclosure_filter.config import AlignmentSettings, AmbiguitySettings
from wiclosure.wiclosure_filter.consensus.consensus import AnchoredPeaks, consensus
from wiclosure.wiclosure_filter.consensus.pairwise_consistency import pairwise_consistency
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem, PairOdometry
from wiclosure.wiclosure_filter.consensus.spatial_refinement import refine_in_space
from wiclosure.wiclosure_filter.likelihood.fit import Fit
from wiclosure.wiclosure_filter.likelihood.mixture import MIN_DISTANCE_M, Explanation, Mixture
from wiclosure.wiclosure_filter.likelihood.observations import LEVEL_SIGMA_RAD, Observations
from wiclosure.wiclosure_filter.likelihood.residuals import displacements_in_a, explained
from wiclosure.wiclosure_filter.links.links import Links

_NOTHING_FOUND = {
    "consensus": "no two measurements allow an alignment ({knowledge})",
    "pcm": "pairwise consistency needs ranges, bearings and relative headings ({knowledge}); use multipath: consensus",
}


def align(links: Links, trajectories: Mapping[str, Trajectory], settings: AlignmentSettings) -> FrameAlignment:
    """Aligns the odometry frames of two robots.

    Args:
        links: all that they measured of each other; `paths_kept` of the result refers to the log they come from.
        trajectories: odometry of each robot in its own frame.
        settings: what is assumed of the radio, how hard to search, when to refuse.
    """
    links = links.thinned(settings.max_measurements)
    if len(links) == 0:
        return _unknown(links, "no measurement between the robots")
    problem = AlignmentProblem.of(links, trajectories, settings)
    knowledge = problem.heading_knowledge
    if settings.multipath == "pcm":
        found = pairwise_consistency(
            problem, settings.pcm_confidence, max_links=settings.max_pcm_links, height_ratio=settings.height_ratio
        )
    else:
        found = consensus(problem, settings.proposals)
    if found is None:
        return _unknown(links, _NOTHING_FOUND[settings.multipath].format(knowledge=knowledge), knowledge)
    if settings.gravity_aligned:
        chosen = _level(found, links, problem.odometry, settings)
    else:
        chosen = _in_space(found, links, settings)
    reason = chosen.objections[0] if chosen.objections else chosen.support
    return FrameAlignment(
        robot_a=links.robot_a,
        robot_b=links.robot_b,
        best=chosen.best.hypothesis,
        covariance=chosen.best.covariance,
        ambiguous=bool(chosen.objections),
        reason="; ".join((reason, *links.left_out)),
        best_alternative=chosen.others[0] if chosen.others else None,
        heading_knowledge=knowledge,
        likely_alternatives=chosen.others if chosen.likely else (),
        fit=chosen.fit.by_time,
        suspected_fault=chosen.fault,
        calibration=chosen.best.calibration,
        calibration_covariance=None if chosen.best.frames is None else chosen.best.frames.errors.covariance,
        strain=0.0 if chosen.best.frames is None else chosen.best.frames.strain.squared,
        strain_probability=chosen.best.strain_probability(settings.drift_inflation),
    )


@dataclass(frozen=True, eq=False)
class _Chosen:
    """Best alignment, different ones, and how well it fits.

    Args:
        best: as it is reported.
        others: different ones, the best first.
        fit: how well it explains the measurements.
        objections: what forbids to call it certain, the gravest first.
        fault: a systematic error that the measurements speak of, or an empty string.
        support: what carries it.
        likely: whether the different ones are the only others that are likely.
    """

    best: _Followed
    others: tuple[AlignmentHypothesis, ...]
    fit: Fit
    objections: tuple[str, ...]
    fault: str
    support: str
    likely: bool

    @classmethod
    def of(
        cls,
        selection: Selection,
        followed: Sequence[_Followed],
        second: SecondAlignment | None,
        settings: AlignmentSettings,
        indistinct: _Indistinct | None = None,
    ) -> _Chosen:
        """From the selection among the peaks, those that are reported, and the blunders that would fit as well."""
        best, *others = followed
        fit = best.fit
        misfit = fit.misfit(settings.guard.min_fit_probability)
        sentence = "" if second is None else second.sentence
        slip = sentence if second is not None and second.slip else best.slip(settings.guard.min_odds)
        ambiguous = selection.reason if selection.ambiguous else best.vague
        blunder = "" if indistinct is None else indistinct.sentence
        extraordinary = best.extraordinary(settings.guard.min_odds)
        found = (extraordinary, sentence or slip, misfit, ambiguous, blunder)
        objections = tuple(objection for objection in found if objection)
        only_blunders = indistinct is not None and objections == (blunder,)
        return cls(
            best,
            indistinct.hypotheses if indistinct and only_blunders else tuple(other.hypothesis for other in others),
            fit,
            objections,
            extraordinary or slip or misfit or blunder,
            selection.reason,
            likely=bool(only_blunders or second or (selection.alternatives and not misfit and not slip)),
        )


def _level(found: AnchoredPeaks, links: Links, odometry: PairOdometry, settings: AlignmentSettings) -> _Chosen:
    """Between level frames."""
    selection = assess(found.peaks, found.mixture, found.prior, settings.guard)
    second = None
    if found.chosen is None and not selection.ambiguous:
        second = second_alignment(
            found, selection.best, selection.different, selection.log_volume, settings.guard.min_odds
        )
    rows = (selection.best, *(selection.others if second is None else (second.row,)))
    several = found.chosen is None and len(links) > 1
    others = several and drift_matters(found.drift, found.mixture.observations)  # the best one is calibrated besides
    followed = [
        _followed(
            found, row, links, odometry, selection.covariance, settings, follow=others or (several and row == rows[0])
        )
        for row in rows
    ]
    indistinct = None
    if not selection.ambiguous and settings.guard.weigh_blunders:
        indistinct = _Indistinct.of(followed[0], found, links, odometry, settings.guard)
    return _Chosen.of(selection, followed, second, settings, indistinct)


@dataclass(frozen=True, eq=False)
class _Indistinct:
    """Blunders that would fit as well as the best alignment: a sentence, and the alignment under each."""

    sentence: str
    hypotheses: tuple[AlignmentHypothesis, ...]

    @classmethod
    def of(
        cls, best: _Followed, found: AnchoredPeaks, links: Links, odometry: PairOdometry, guard: AmbiguitySettings
    ) -> _Indistinct | None:
        """None where no blunder would, the best alignment was not followed, or has no bearings."""
        frames, observations = best.frames, found.mixture.observations
        if frames is None or not observations.has_bearing.any():
            return None
        blunders = Blunders.of(frames.w, frames.yaw, links, odometry, best.mixture, best.explanation, found.drift[0])
        likely = blunders.likely(guard.same_place_fraction * observations.typical_distance_m, guard.min_odds)
        if not likely:
            return None
        return cls(blunders.objection(likely), tuple(blunders.hypothesis(rows[0], best.hypothesis) for rows in likely))


def _in_space(found: AnchoredPeaks, links: Links, settings: AlignmentSettings) -> _Chosen:
    """Over all of SE(3)."""
    peaks = refine_in_space(found.peaks, found.mixture, found.prior, links, settings.tilt_sigma_rad)
    selection = assess(peaks.level, found.mixture, found.prior, settings.guard, peaks.explanation)
    followed = []
    for row in (selection.best, *selection.others):
        explanation, T_a_b = peaks.explanation.at(row), peaks.T_a_b[row]
        distance_m = np.linalg.norm(se3.transform(T_a_b, links.antenna_b) - links.antenna_a, axis=1)
        hypothesis = AlignmentHypothesis(
            T_a_b=T_a_b,
            log_likelihood=float(explanation.log_likelihood[0] @ found.mixture.observations.independence),
            paths_kept=_paths_kept(explanation, links, None),
        )
        followed.append(_Followed(hypothesis, peaks.covariance[row], found.mixture, explanation, distance_m))
    return _Chosen.of(selection, followed, None, settings)


@dataclass(frozen=True, eq=False)
class _Followed:
    """A peak, followed through the drift of both robots where that matters.

    Args:
        hypothesis: as it is reported.
        covariance: `(6, 6)`.
        mixture: likelihood of the measurements, without the drift that was followed.
        explanation: of the measurements; leading dimension 1.
        distance_m: `(M,)` of the antennas.
        frames: the chain that follows the drift; None where nothing was to follow.
        vague: why it is too vague to prune by, or an empty string.
        calibration: systematic errors that were estimated along with it.
    """

    hypothesis: AlignmentHypothesis
    covariance: FloatArray
    mixture: Mixture
    explanation: Explanation
    distance_m: FloatArray
    frames: DriftingFrames | None = None
    vague: str = ""
    calibration: tuple[Calibration, ...] = ()

    @property
    def fit(self) -> Fit:
        """How well it explains the measurements."""
        return Fit.of(self.mixture, self.explanation, self.distance_m)

    def slip(self, min_odds: float) -> str:
        """Why the odometry seems to slip, or an empty string."""
        return "" if self.frames is None else self.frames.strain.slip(min_odds)

    def strain_probability(self, inflation: float) -> float:
        """That odometry and systematic errors of their usual size are bent as far."""
        return 1.0 if self.frames is None else self.frames.strain.probability(inflation)

    def extraordinary(self, min_odds: float) -> str:
        """Systematic errors that are far larger than usual, or may be: a sentence; empty where the odds are against."""
        suspicious = -np.log(min_odds * CONSTANT_BLUNDER)
        beyond = [
            str(error)
            for number, error in enumerate(self.calibration)
            if error.extraordinary or (number != RANGE_SCALE and error.log_blunder > suspicious)
        ]
        return f"the measurements tell a systematic error beyond the usual: {'; '.join(beyond)}" if beyond else ""


def _followed(
    found: AnchoredPeaks,
    row: int,
    links: Links,
    odometry: PairOdometry,
    covariance: FloatArray,
    settings: AlignmentSettings,
    *,
    follow: bool,
) -> _Followed:
    mixture, observations = found.mixture, found.mixture.observations
    state, explanation = found.peaks.states[row], explained(found.peaks.states[row], mixture)
    w = displacements_in_a(state[None], observations)[1][0]
    frames, vague = None, ""
    calibration: tuple[Calibration, ...] = ()
    if follow:
        with suppress(np.linalg.LinAlgError):  # steps of millions of metres leave no digits for the rest
            frames = follow_drift(state, mixture, found.drift, found.prior, odometry, settings.calibration)
            state, explanation, w = frames.state, frames.explanation, frames.w
            covariance = frames.covariance + _spread(covariance, found.peaks.information[row])
            mixture = Mixture.of(frames.corrected, mixture.radio)
            calibration = frames.errors.calibrations(links.robot_a, links.robot_b)
            vague = unobservable(covariance, observations, settings.guard)
    hypothesis = AlignmentHypothesis(
        T_a_b=observations.frame_transform(state),
        log_likelihood=float(explanation.log_likelihood[0] @ observations.independence),
        paths_kept=_paths_kept(explanation, links, None if found.chosen is None else found.chosen[row]),
    )
    distance_m = np.maximum(np.linalg.norm(w, axis=1), MIN_DISTANCE_M)
    covariance = tangent_covariance(state, covariance, observations)
    return _Followed(hypothesis, covariance, mixture, explanation, distance_m, frames, vague, calibration)


def _spread(covariance: FloatArray, information: FloatArray) -> FloatArray:
    """What peaks near the best one add to its covariance `(4, 4)`."""
    alone = np.linalg.inv(information + 1e-9 * np.trace(information) * np.eye(4))
    values, vectors = np.linalg.eigh(covariance - alone)
    return np.asarray((vectors * np.maximum(values, 0.0)) @ vectors.T)


def _paths_kept(explanation: Explanation, links: Links, chosen: IntArray | None) -> tuple[tuple[int, int], ...]:
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


def _unknown(links: Links, reason: str, knowledge: str = "none") -> FrameAlignment:
    because = "; ".join((reason, *links.left_out))
    return FrameAlignment(links.robot_a, links.robot_b, None, None, True, because, None, knowledge)
