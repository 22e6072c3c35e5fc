"""Links cut where odometry slips: those before and those after tell one alignment each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray, FrameAlignment, Trajectory
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.drift.strain import SLIP_ODDS
from wiclosure.wiclosure_filter.likelihood.observations import UNKNOWN_DISTANCE_M
from wiclosure.wiclosure_filter.links.links import Links


@dataclass(frozen=True, eq=False)
class Side:
    """What was measured before a slip, or after it.

    Args:
        links: the measurements.
        end: of each robot, the first keyframe that cannot be on this side any more, or the first that can be.
        before: which of the two sides it is.
    """

    links: Links
    end: Mapping[str, int]
    before: bool

    def stretch(self, slipped: str, trajectories: Mapping[str, Trajectory]) -> dict[str, range]:
        """Keyframes that the side's alignment holds for if this robot slipped: all of the other one."""
        whole = {robot: range(len(trajectory)) for robot, trajectory in trajectories.items()}
        own = whole[slipped]
        return whole | {slipped: own[: self.end[slipped]] if self.before else own[self.end[slipped] :]}


def sides(links: Links, alignment: FrameAlignment, trajectories: Mapping[str, Trajectory]) -> tuple[Side, Side]:
    """Before and after the stretch of time in which odometry slips; keyframes within it may be on either side."""
    assert alignment.bent_ns is not None
    since_ns, until_ns = alignment.bent_ns
    before, after = (np.flatnonzero(chosen) for chosen in (links.stamp_a_ns <= since_ns, links.stamp_a_ns >= until_ns))
    a, b = links.robot_a, links.robot_b
    last, first = ((links.stamp_a_ns[rows], links.stamp_b_ns[rows]) for rows in (before, after))
    until, since = {}, {}
    for number, robot in enumerate((a, b)):
        stamps_ns = trajectories[robot].stamps_ns
        until[robot] = int(np.searchsorted(stamps_ns, first[number].min(), side="right"))
        since[robot] = int(np.searchsorted(stamps_ns, last[number].max(), side="left"))
    return Side(links.subset(before), until, before=True), Side(links.subset(after), since, before=False)


def gain_of_cut(
    bent: FrameAlignment,
    claimed: FrameAlignment,
    links: Links,
    trajectories: Mapping[str, Trajectory],
    settings: AlignmentSettings,
) -> float:
    """By how much more two alignments explain than one (natural logarithm of odds); -inf where one is not certain.

    Args:
        bent: tells when odometry slips.
        claimed: of all links.
        links: of both robots.
        trajectories: of both.
        settings: of the alignment.
    """
    assert claimed.best is not None  # it is bent
    gained, log_volumes = claimed.strain / 2 - claimed.best.log_likelihood, []
    for side in sides(links, bent, trajectories):
        aligned = align(side.links, trajectories, settings)
        if aligned.ambiguous or aligned.best is None or aligned.covariance is None:
            return -np.inf
        gained += aligned.best.log_likelihood - aligned.strain / 2
        log_volumes.append(_log_volume(aligned.covariance, side.links))
    times = np.log(max(len(links) - 1, 1))
    return float(gained + min(log_volumes) - times + np.log(SLIP_ODDS))


def _log_volume(covariance: FloatArray, links: Links) -> float:
    """Of a level alignment, as a part of all yaws and places within twice the usual distance."""
    ranged = links.range_m[np.isfinite(links.range_m)]
    distance_m = float(np.median(ranged)) if len(ranged) else UNKNOWN_DISTANCE_M
    own = np.linalg.slogdet(2 * np.pi * covariance[2:5, 2:5])[1] / 2
    return float(own - np.log(2 * np.pi * np.pi * (2 * distance_m) ** 2))
