"""How the odometry frames of two robots lie, from their links; or a sentence on why the links do not tell."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from wiclosure.types import AlignmentHypothesis, FloatArray, FrameAlignment, IntArray, Trajectory
from wiclosure.wiclosure_filter.alignment.ambiguity import Verdict, assess
from wiclosure.wiclosure_filter.alignment.consensus import AnchoredPeaks, consensus
from wiclosure.wiclosure_filter.alignment.drifting_frames import drift_matters, follow_drift
from wiclosure.wiclosure_filter.alignment.mixture import Explanation
from wiclosure.wiclosure_filter.alignment.observations import LEVEL_SIGMA_RAD, Observations
from wiclosure.wiclosure_filter.alignment.pairwise_consistency import pairwise_consistency
from wiclosure.wiclosure_filter.alignment.problem import AlignmentProblem, PairOdometry
from wiclosure.wiclosure_filter.alignment.residuals import explained
from wiclosure.wiclosure_filter.alignment.spatial_refinement import refine_in_space
from wiclosure.wiclosure_filter.config import AlignmentSettings, AmbiguitySettings
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
        chosen = _level(found, links, problem.odometry, settings.guard)
    else:
        chosen = _in_space(found, links, settings.tilt_sigma_rad, settings.guard)
    return FrameAlignment(
        robot_a=links.robot_a,
        robot_b=links.robot_b,
        best=chosen.best,
        covariance=chosen.covariance,
        ambiguous=chosen.verdict.ambiguous,
        reason="; ".join((chosen.verdict.reason, *links.left_out)),
        runner_up=chosen.others[0] if chosen.others else None,
        heading_knowledge=knowledge,
        rivals=chosen.others if chosen.verdict.alternatives else (),
    )


@dataclass(frozen=True, eq=False)
class _Chosen:
    """Best alignment, its covariance `(6, 6)`, different ones, the best first, and whether it is certain."""

    best: AlignmentHypothesis
    covariance: FloatArray
    others: tuple[AlignmentHypothesis, ...]
    verdict: Verdict


def _level(found: AnchoredPeaks, links: Links, odometry: PairOdometry, guard: AmbiguitySettings) -> _Chosen:
    """Between level frames."""
    verdict = assess(found.peaks, found.mixture, found.prior, guard)
    best, *others = (
        _followed(found, row, links, odometry, verdict.covariance) for row in (verdict.best, *verdict.others)
    )
    return _Chosen(*best, tuple(hypothesis for hypothesis, _ in others), verdict)


def _in_space(found: AnchoredPeaks, links: Links, tilt_sigma_rad: float, guard: AmbiguitySettings) -> _Chosen:
    """Over all of SE(3)."""
    peaks = refine_in_space(found.peaks, found.mixture, found.prior, links, tilt_sigma_rad)
    verdict = assess(peaks.level, found.mixture, found.prior, guard, peaks.explanation)
    counted = found.mixture.observations.independence
    best, *others = (
        AlignmentHypothesis(
            T_a_b=peaks.T_a_b[row],
            log_likelihood=float(peaks.explanation.log_likelihood[row] @ counted),
            paths_kept=_paths_kept(peaks.explanation.at(row), links, None),
        )
        for row in (verdict.best, *verdict.others)
    )
    return _Chosen(best, peaks.covariance[verdict.best], tuple(others), verdict)


def _followed(
    found: AnchoredPeaks, row: int, links: Links, odometry: PairOdometry, covariance: FloatArray
) -> tuple[AlignmentHypothesis, FloatArray]:
    """A peak, followed through the drift of both robots where that matters, and its covariance `(6, 6)`."""
    observations = found.mixture.observations
    state, explanation = found.peaks.states[row], explained(found.peaks.states[row], found.mixture)
    if found.chosen is None and drift_matters(found.drift, observations):
        with suppress(np.linalg.LinAlgError):  # steps of millions of metres leave no digits for the rest
            frames = follow_drift(state, found.mixture, found.drift, found.prior, odometry)
            state, explanation, covariance = frames.state, frames.explanation, frames.covariance
    hypothesis = AlignmentHypothesis(
        T_a_b=observations.frame_transform(state),
        log_likelihood=float(explanation.log_likelihood[0] @ observations.independence),
        paths_kept=_paths_kept(explanation, links, None if found.chosen is None else found.chosen[row]),
    )
    return hypothesis, tangent_covariance(state, covariance, observations)


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
