"""From what two robots heard of each other to how their odometry frames lie, or the honest answer "I cannot tell"."""

from __future__ import annotations

from collections.abc import Mapping

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
from wiclosure.wiclosure_filter.refinement import explained

_LEVEL_SIGMA_RAD = 0.01  # gravity-aligned frames agree on the vertical, nearly


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
    found = consensus(observations, knowledge, partner, both, settings)
    if found is None:
        return _unknown(links, "the measurements do not allow any alignment", knowledge)
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
    return AlignmentHypothesis(
        T_a_b=found.mixture.observations.frame_transform(state),
        log_likelihood=float(found.mixture.log_likelihood(state[None])[0]),
        paths_kept=_paths_kept(found, state, links),
    )


def _paths_kept(found: AnchoredPeaks, state: FloatArray, links: Links) -> tuple[tuple[int, int], ...]:
    """The path of each measurement that more likely than not is the direct one; -1 for a range without direction."""
    explanation = explained(state, found.mixture)
    path = explanation.path[0]
    best = np.argmax(path, axis=1)
    direct = path[np.arange(len(links)), best] > 0.5
    ranged = links.has_range & (explanation.in_sight[0] + explanation.obstructed[0] > 0.5)
    chosen = np.where(direct, links.path[np.arange(len(links)), best], -1)
    kept = direct | ranged
    return tuple((int(m), int(k)) for m, k in zip(links.measurement[kept], chosen[kept], strict=True))


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
