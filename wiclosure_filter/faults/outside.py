"""Measurements outside a robot's odometry: the log went on longer, or a clock is off.

Robots that drive straight at constant speed look the same under any shift of a clock.  What tells then is that a log
of two robots that both record lies within both recordings.  A log may be longer, so this names no fault: an alignment
is not certain while a shift that brings more measurements inside fits all of them, and those inside before as well.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.alignment.align import align, align_together
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.faults.corrections import Correction, RadioInputs, clocks_apart, odometry_clock_off
from wiclosure.wiclosure_filter.faults.diagnosis import between, quick_settings
from wiclosure.wiclosure_filter.likelihood.observations import UNKNOWN_DISTANCE_M
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

_SHIFTS = 9  # where no shift is told, any fits: a few of them tell whether


def clocks_in_doubt(
    alignments: Mapping[tuple[str, str], FrameAlignment],
    links: Mapping[tuple[str, str], Links],
    trajectories: Mapping[str, Trajectory],
    log: WirelessLog,
    settings: AlignmentSettings,
) -> dict[tuple[str, str], str]:
    """Of alignments that prune, those of which a shifted clock would explain as much and more: why, as a sentence.

    Args:
        alignments: of pairs of robots; those whose log was corrected are not looked at.
        links: of each pair, as the log claims.
        trajectories: of all robots.
        log: all measurements.
        settings: of the alignment.
    """
    if not settings.guard.weigh_blunders:
        return {}
    prune = [pair for pair, one in alignments.items() if not one.ambiguous or one.likely_alternatives]
    asked = [pair for pair in prune if not alignments[pair].corrections and len(links[pair]) and links[pair].left_out]
    quick, found = quick_settings(settings), {}
    for pair, own in between(log, asked).items():
        objection = _objection(({robot: trajectories[robot] for robot in pair}, own), quick)
        if objection:
            found[pair] = objection
    return found


def _objection(inputs: RadioInputs, settings: AlignmentSettings) -> str:
    shifts = list(_shifts(inputs, settings.stamp_tolerance_s))
    if not shifts:
        return ""
    claimed_links = _links(inputs, settings)  # rows of the pair's own log, as those of the shifted ones
    claimed = align(claimed_links, inputs[0], settings)
    corrected = [shift.apply(inputs) for shift in shifts]
    whole = [_links(one, settings) for one in corrected]
    inside = claimed_links.measurement
    common = [links.subset(np.flatnonzero(np.isin(links.measurement, inside))) for links in whole]
    alignments = align_together(
        [(one, read[0]) for links in (whole, common) for one, read in zip(links, corrected, strict=True)], settings
    )
    for shift, all_of_it, of_common in zip(shifts, alignments, alignments[len(shifts) :], strict=False):
        odds = _log_likelihood(claimed) - _log_likelihood(of_common)
        fits = not all_of_it.suspected_fault and odds < np.log(settings.guard.min_odds)
        if fits and _apart_m(claimed, all_of_it, claimed_links) > _same_place_m(claimed_links, settings):
            measured = len(inputs[1].measurements)
            return (
                f"{measured - len(inside)} of {measured} measurements lie outside the odometry's time: a longer log"
                f" would fit as well as a clock that is off, which would put the robots elsewhere ({shift.fault})"
            )
    return ""


def _shifts(inputs: RadioInputs, tolerance_s: float) -> Iterator[Correction]:
    """Shifts that bring the most measurements into both odometries' time, where that is more than without one."""
    trajectories, log = inputs
    a, b = trajectories
    at = {robot: np.array([_stamp_s(m, robot) for m in log.measurements]) for robot in (a, b)}
    span = {
        robot: np.array([own.stamps_ns[0] / 1e9 - tolerance_s, own.stamps_ns[-1] / 1e9 + tolerance_s])
        for robot, own in trajectories.items()
    }
    room = {robot: span[robot][:, None] - at[robot] for robot in (a, b)}  # shifts that bring each inside
    within = {robot: (room[robot][0] <= 0) & (room[robot][1] >= 0) for robot in (a, b)}
    a_receives = np.array([m.receiver == a for m in log.measurements])
    for robot, other in ((a, b), (b, a)):
        for shift_s in _most_inside(*room[robot][:, within[other]]):
            yield odometry_clock_off(robot, shift_s)
    if a_receives.any() and not a_receives.all():  # else it is the same as one of those
        received = np.where(a_receives, within[a], within[b])
        of_transmitter = np.where(a_receives, room[b], -room[a][::-1])
        for shift_s in _most_inside(*of_transmitter[:, received]):
            yield clocks_apart(b, shift_s)


def _most_inside(low_s: FloatArray, high_s: FloatArray) -> FloatArray:
    """Of intervals `(M,)`, evenly over the stretch within most of them, the nearest to zero; none if that has zero."""

    def containing(shifts_s: FloatArray) -> FloatArray:
        begun, ended = np.searchsorted(np.sort(low_s), shifts_s, "right"), np.searchsorted(np.sort(high_s), shifts_s)
        return np.asarray(begun - ended)

    ends_s = np.concatenate([low_s, high_s])
    inside = containing(ends_s)
    if inside.max(initial=0) <= containing(np.zeros(1))[0]:
        return np.zeros(0)
    nearest_s = ends_s[inside == inside.max()]
    nearest_s = nearest_s[np.argmin(np.abs(nearest_s))]
    holds = (low_s <= nearest_s) & (nearest_s <= high_s)
    return np.linspace(low_s[holds].max(), high_s[holds].min(), _SHIFTS)


def _stamp_s(m: WirelessMeasurement, robot: str) -> float:
    sent_ns = m.stamp_ns if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns
    return (m.stamp_ns if m.receiver == robot else sent_ns) / 1e9


def _links(inputs: RadioInputs, settings: AlignmentSettings) -> Links:
    (links,) = TeamLinks.of(*inputs, GatheringLimits.of(settings)).by_pair.values()
    return links


def _log_likelihood(alignment: FrameAlignment) -> float:
    return -np.inf if alignment.best is None else alignment.best.log_likelihood - alignment.strain / 2


def _apart_m(one: FrameAlignment, other: FrameAlignment, links: Links) -> float:
    """How far two alignments put b's antennas from each other."""
    if one.best is None or other.best is None:
        return 0.0
    by_one, by_other = (se3.transform(best.T_a_b, links.antenna_b) for best in (one.best, other.best))
    return float(np.linalg.norm(by_one - by_other, axis=1).mean())


def _same_place_m(links: Links, settings: AlignmentSettings) -> float:
    ranged = links.range_m[links.has_range]
    distance_m = float(np.median(ranged)) if len(ranged) else UNKNOWN_DISTANCE_M
    return settings.guard.same_place_fraction * distance_m
