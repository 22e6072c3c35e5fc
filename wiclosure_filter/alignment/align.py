"""How the odometry frames of two robots lie, from their links; or a sentence on why the links do not tell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, FrameAlignment, Trajectory
from wiclosure.wiclosure_filter.alignment.ambiguity import assess
from wiclosure.wiclosure_filter.alignment.chosen_alignment import ChosenAlignment
from wiclosure.wiclosure_filter.alignment.followed import Followed, paths_kept
from wiclosure.wiclosure_filter.alignment.level_peaks import LevelPeaks
from wiclosure.wiclosure_filter.alignment.roles import as_named, with_reference_first
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.consensus.consensus import AnchoredPeaks, consensus
from wiclosure.wiclosure_filter.consensus.pairwise_consistency import pairwise_consistency
from wiclosure.wiclosure_filter.consensus.problem import AlignmentProblem
from wiclosure.wiclosure_filter.consensus.spatial_refinement import refine_in_space
from wiclosure.wiclosure_filter.drift.drifting_frames import follow_drifts
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
    return align_together([(links, trajectories)], settings)[0]


def align_together(
    pairs: Iterable[tuple[Links, Mapping[str, Trajectory]]], settings: AlignmentSettings
) -> list[FrameAlignment]:
    """Alignments of many pairs of robots, of which drift is followed together: that is most of the work."""
    given = [*pairs]
    started = [_started(with_reference_first(links), trajectories, settings) for links, trajectories in given]
    frames = iter(follow_drifts([rigid for one in started if isinstance(one, LevelPeaks) for rigid in one.to_follow]))
    found = (one.alignment(frames) if isinstance(one, LevelPeaks) else one for one in started)
    return [as_named(one, links) for one, (links, _) in zip(found, given, strict=True)]


def _started(
    links: Links, trajectories: Mapping[str, Trajectory], settings: AlignmentSettings
) -> FrameAlignment | LevelPeaks:
    """As far as it goes without following drift."""
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
        return LevelPeaks.of(found, links, problem, settings)
    return _in_space(found, links, settings).alignment(links, knowledge, settings)


def _in_space(found: AnchoredPeaks, links: Links, settings: AlignmentSettings) -> ChosenAlignment:
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
            paths_kept=paths_kept(explanation, links, None),
        )
        followed.append(Followed(hypothesis, peaks.covariance[row], found.mixture, explanation, distance_m))
    return ChosenAlignment.of(selection, followed, None, settings)


def _unknown(links: Links, reason: str, knowledge: str = "none") -> FrameAlignment:
    because = "; ".join((reason, *links.left_out))
    return FrameAlignment(links.robot_a, links.robot_b, None, None, True, because, None, knowledge)
