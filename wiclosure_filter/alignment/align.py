"""From what two robots heard of each other to how their odometry frames lie, or the honest answer "I cannot tell"."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress

import numpy as np

from wiclosure.types import (
    AlignmentHypothesis,
    FloatArray,
    FrameAlignment,
    IntArray,
    Trajectory,
    WirelessLog,
)
from wiclosure.wiclosure_filter.alignment.ambiguity import Verdict, judge
from wiclosure.wiclosure_filter.alignment.consensus import AnchoredPeaks, consensus
from wiclosure.wiclosure_filter.alignment.drifting_frames import drift_matters, follow_drift
from wiclosure.wiclosure_filter.alignment.mixture import Explanation
from wiclosure.wiclosure_filter.alignment.observations import Observations
from wiclosure.wiclosure_filter.alignment.pairwise_consistency import pairwise_consistency
from wiclosure.wiclosure_filter.alignment.refinement import explained
from wiclosure.wiclosure_filter.alignment.settings import AlignmentSettings
from wiclosure.wiclosure_filter.alignment.spatial_refinement import refine_in_space
from wiclosure.wiclosure_filter.links.gathering import links_between
from wiclosure.wiclosure_filter.links.links import Links

_Method = Callable[
    [Observations, str, IntArray, tuple[Trajectory, Trajectory], AlignmentSettings], AnchoredPeaks | None
]
_LEVEL_SIGMA_RAD = 0.01  # gravity-aligned frames agree on the vertical, nearly

_METHODS: Mapping[str, _Method] = {"consensus": consensus, "pcm": pairwise_consistency}
_NOTHING_FOUND = {
    "consensus": "no two measurements allow an alignment ({knowledge})",
    "pcm": "pairwise consistency needs ranges, bearings and relative headings ({knowledge}); use multipath: consensus",
}


def align(
    robot_a: str,
    robot_b: str,
    trajectories: Mapping[str, Trajectory],
    wireless: WirelessLog,
    settings: AlignmentSettings,
) -> FrameAlignment:
    """Aligns the odometry frames of two robots.

    Args:
        robot_a: name in `trajectories`.
        robot_b: another.
        trajectories: odometry of each robot in its own frame.
        wireless: the whole log; `paths_kept` of the result refers to its measurements.
        settings: what is believed of the radio, how hard to search, when to refuse.
    """
    links = links_between(robot_a, robot_b, trajectories, wireless, settings).thinned(settings.max_measurements)
    if len(links) == 0:
        return _unknown(links, "no measurement between the robots")
    observations = Observations.of(links, settings)
    partner = reciprocal_partners(links, settings.reciprocal_tolerance_s)
    knowledge = heading_knowledge(links, partner, settings)
    both = (trajectories[robot_a], trajectories[robot_b])
    reject_multipath = _METHODS[settings.multipath]
    found = reject_multipath(observations, knowledge, partner, both, settings)
    if found is None:
        return _unknown(links, _NOTHING_FOUND[settings.multipath].format(knowledge=knowledge), knowledge)
    settle = _settled_level if settings.gravity_aligned else _settled_in_space
    best, covariance, others, verdict = settle(found, links, both, settings)
    return FrameAlignment(
        robot_a=robot_a,
        robot_b=robot_b,
        best=best,
        covariance=covariance,
        ambiguous=verdict.ambiguous,
        reason="; ".join((verdict.reason, *links.left_out)),
        runner_up=others[0] if others else None,
        heading_knowledge=knowledge,
        rivals=others if verdict.rivals else (),
    )


def heading_knowledge(links: Links, partner: IntArray, settings: AlignmentSettings) -> str:
    """What tells the relative yaw: the strongest source that the log holds, or the one asked for."""
    if settings.heading != "auto":
        return settings.heading
    if np.isfinite(links.yaw).any():
        return "heading"
    if (partner >= 0).any():
        return "reciprocal"
    return "one-way" if links.has_bearing.any() else "range-only"


def reciprocal_partners(links: Links, tolerance_s: float) -> IntArray:
    """`(M,)` for each bearing, the bearing the other way nearest in time; -1 where there is none within tolerance."""
    partner = np.full(len(links), -1)
    here, there = (np.flatnonzero(links.has_bearing & (links.a_receives == way)) for way in (True, False))
    if len(here) == 0 or len(there) == 0:
        return partner
    apart = np.abs(links.stamp_a_ns[here][:, None] - links.stamp_a_ns[there][None, :])
    for rows, others, gap in ((here, there, apart), (there, here, apart.T)):
        nearest = np.argmin(gap, axis=1)
        close = gap[np.arange(len(rows)), nearest] <= tolerance_s * 1e9
        partner[rows[close]] = others[nearest[close]]
    return partner


_Settled = tuple[AlignmentHypothesis, FloatArray, tuple[AlignmentHypothesis, ...], Verdict]


def _settled_level(
    found: AnchoredPeaks, links: Links, trajectories: tuple[Trajectory, Trajectory], settings: AlignmentSettings
) -> _Settled:
    """Best alignment, its covariance, different ones, the best first, and the guard's verdict, between level frames."""
    verdict = judge(found.peaks, found.mixture, found.prior, settings)
    best, covariance = _followed(found, verdict.best, links, trajectories, settings, verdict.covariance)
    others = tuple(
        _followed(found, row, links, trajectories, settings, verdict.covariance)[0] for row in verdict.others
    )
    return best, covariance, others, verdict


def _settled_in_space(
    found: AnchoredPeaks, links: Links, _: tuple[Trajectory, Trajectory], settings: AlignmentSettings
) -> _Settled:
    """The same over all of SE(3)."""
    peaks = refine_in_space(found.peaks, found.mixture, found.prior, links, settings)
    verdict = judge(peaks.level, found.mixture, found.prior, settings, peaks.explanation)
    counted = found.mixture.observations.independence
    best, *others = (
        AlignmentHypothesis(
            T_a_b=peaks.T_a_b[row],
            log_likelihood=float(peaks.explanation.log_likelihood[row] @ counted),
            paths_kept=_paths_kept(peaks.explanation.at(row), links, None),
        )
        for row in (verdict.best, *verdict.others)
    )
    return best, peaks.covariance[verdict.best], tuple(others), verdict


def _followed(
    found: AnchoredPeaks,
    row: int,
    links: Links,
    trajectories: tuple[Trajectory, Trajectory],
    settings: AlignmentSettings,
    covariance: FloatArray,
) -> tuple[AlignmentHypothesis, FloatArray]:
    """A peak, followed through the drift of both robots where that matters, and its covariance `(6, 6)`."""
    observations = found.mixture.observations
    state, explanation = found.peaks.states[row], explained(found.peaks.states[row], found.mixture)
    if found.chosen is None and drift_matters(found.drift, observations):
        with suppress(np.linalg.LinAlgError):  # steps of millions of metres leave no digits for the rest
            frames = follow_drift(state, found.mixture, found.drift, found.prior, trajectories, settings)
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
    level = np.diag([_LEVEL_SIGMA_RAD**2, _LEVEL_SIGMA_RAD**2, 0.0, 0.0, 0.0, 0.0])
    return np.asarray(to_tangent @ covariance @ to_tangent.T + level)


def _unknown(links: Links, reason: str, knowledge: str = "none") -> FrameAlignment:
    because = "; ".join((reason, *links.left_out))
    return FrameAlignment(links.robot_a, links.robot_b, None, None, True, because, None, knowledge)
