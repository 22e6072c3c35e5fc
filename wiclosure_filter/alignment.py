"""From what two robots heard of each other to how their odometry frames lie, or the honest answer "I cannot tell"."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from wiclosure.types import (
    AlignmentHypothesis,
    FloatArray,
    FrameAlignment,
    IntArray,
    Trajectory,
    WirelessLog,
)
from wiclosure.wiclosure_filter.alignment_settings import AlignmentSettings
from wiclosure.wiclosure_filter.ambiguity import judge
from wiclosure.wiclosure_filter.consensus import AnchoredPeaks, consensus
from wiclosure.wiclosure_filter.links import Links, links_between
from wiclosure.wiclosure_filter.observations import Observations
from wiclosure.wiclosure_filter.pairwise_consistency import pairwise_consistency
from wiclosure.wiclosure_filter.refinement import explained

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
    links = links_between(robot_a, robot_b, trajectories, wireless, settings)
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
    verdict = judge(found.peaks, found.mixture, found.prior, settings)
    return FrameAlignment(
        robot_a=robot_a,
        robot_b=robot_b,
        best=_hypothesis(found, verdict.best, links),
        covariance=tangent_covariance(found.peaks.states[verdict.best], verdict.covariance, observations),
        ambiguous=verdict.ambiguous,
        reason="; ".join((verdict.reason, *links.left_out)),
        runner_up=None if verdict.runner_up is None else _hypothesis(found, verdict.runner_up, links),
        heading_knowledge=knowledge,
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


def _hypothesis(found: AnchoredPeaks, row: int, links: Links) -> AlignmentHypothesis:
    state = found.peaks.states[row]
    explanation = explained(state, found.mixture)
    each = np.arange(len(links))
    direct, ranged = explanation.direct(), explanation.ranged()
    if found.chosen is not None:  # the method decides for itself
        direct = found.chosen[row]
        ranged = direct >= 0
    kept = (direct >= 0) | (ranged & links.has_range)
    path = np.where(direct >= 0, links.path[each, direct], -1)
    return AlignmentHypothesis(
        T_a_b=found.mixture.observations.frame_transform(state),
        log_likelihood=float(explanation.log_likelihood[0] @ found.mixture.observations.independence),
        paths_kept=tuple((int(m), int(k)) for m, k in zip(links.measurement[kept], path[kept], strict=True)),
    )


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
