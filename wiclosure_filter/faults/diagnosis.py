"""Which systematic error, if any, explains what two robots measured better than what their log claims.

Tried only where the measurements do not fit the best alignment, and of an image in a wall where they fit worse than
usual: each correction is made, the frames are aligned again, and its alignment must be certain, must fit, and must be
far likelier.  Where none does, the counts tell at least which kind of measurement to look at.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, Heading, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.alignment.align import align, align_together
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.faults.corrections import (
    Correction,
    RadioInputs,
    azimuths_off,
    corrections,
    ranges_off,
    slipped,
)
from wiclosure.wiclosure_filter.faults.cut import gain_of_cut
from wiclosure.wiclosure_filter.likelihood.residuals import mode
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

STRAINED = 0.05  # probability of a strain from which corrections are tried
_USUAL_FIT = 0.5  # probability of a fit, as of every other honest radio behind walls
LIKELIER = np.log(1000.0)  # odds by which a fault must explain more: one log in some hundred has one
_PROPOSALS, _MEASUREMENTS = 1000, 40  # a correction that is right needs no long search
_WIDTH_RAD, _WIDTH_M = 0.1, 0.5  # of peaks among residuals
_LEAST_OFF_RAD, _LEAST_OFF_M = 0.15, 1.0


def worth_a_diagnosis(alignment: FrameAlignment) -> bool:
    """Whether a correction may explain more: where measurements do not fit, or an image in a wall may explain them."""
    return _misfits(alignment) or _may_be_an_image(alignment)


def _may_be_an_image(alignment: FrameAlignment) -> bool:
    """Whether so many measurements are left unexplained that b's image may explain them, by an alignment that prunes.

    What b's path shares with its image fits an alignment metres away, as well as a radio behind walls would.
    """
    prunes = not alignment.ambiguous or bool(alignment.likely_alternatives)
    return prunes and alignment.fit is not None and alignment.fit.probability < _USUAL_FIT


def _misfits(alignment: FrameAlignment) -> bool:
    """Not where all that is wrong is that blunders would fit just as well."""
    # What fits already can gain no more by a correction than its strain.
    if alignment.strain_probability < STRAINED and alignment.strain / 2 > LIKELIER:
        return True
    others, best = alignment.likely_alternatives, alignment.best
    if alignment.only_blunders and best is not None:
        return bool(max(other.log_likelihood for other in others) - best.log_likelihood > LIKELIER)
    return bool(alignment.suspected_fault)


def likeliest(
    alignment: FrameAlignment, trajectories: Mapping[str, Trajectory], log: WirelessLog, settings: AlignmentSettings
) -> int | None:
    """Which of the corrections that are `tried` makes the measurements fit; a number, which processes can exchange."""
    possible, claimed = tried(alignment, trajectories, log, settings)
    inputs, quick = _of_pair(alignment, trajectories, log), quick_settings(settings)
    corrected = [correction.apply(inputs) for correction in possible]
    aligned = align_together([(_links(one, quick), one[0]) for one in corrected], quick)
    gains = np.array(
        [
            gain_of_cut(alignment, claimed, _links(inputs, quick), inputs[0], quick)
            if correction.slip
            else _gain(claimed, correction, one)
            for correction, one in zip(possible, aligned, strict=True)
        ]
    )
    return int(np.argmax(gains)) if gains.max(initial=-np.inf) > LIKELIER else None


def tried(
    alignment: FrameAlignment, trajectories: Mapping[str, Trajectory], log: WirelessLog, settings: AlignmentSettings
) -> tuple[list[Correction], FrameAlignment]:
    """All corrections of two robots' measurements that are tried, and their alignment without any."""
    inputs, quick = _of_pair(alignment, trajectories, log), quick_settings(settings)
    claimed = _aligned(inputs, quick)
    if claimed.best is None:
        return [], claimed
    possible = corrections(alignment.robot_a, alignment.robot_b, inputs[1])
    if not _misfits(alignment):
        return [one for one in possible if one.mirrored], claimed
    if alignment.bent_ns is not None:
        first_ns = int(_links(inputs, quick).stamp_a_ns.min())
        possible.append(slipped(*((stamp_ns - first_ns) / 1e9 for stamp_ns in alignment.bent_ns)))
    return possible + _constant_errors(claimed.best.T_a_b, inputs, quick), claimed


def quick_settings(settings: AlignmentSettings) -> AlignmentSettings:
    """Of the alignments that are only compared."""
    guard = settings.guard.model_copy(update={"weigh_blunders": False})
    # Constant errors of a blunder's size are what the corrections are: here each is granted its usual size only.
    usual = settings.calibration.model_copy(update={"blunder_share": 0.0})
    few = {"proposals": _PROPOSALS, "max_measurements": _MEASUREMENTS}
    return settings.model_copy(update={**few, "guard": guard, "calibration": usual})


def with_fault(alignment: FrameAlignment, correction: Correction | None) -> FrameAlignment:
    """The alignment as one that must not be used to prune, with what seems to be wrong."""
    if correction is None:
        return alignment
    remedy = " (--accept-correction applies it)" if correction.of_log else ""
    fault = f"{correction.fault}{remedy}"
    reason = f"{fault}; {alignment.reason}"
    return replace(alignment.doubted(fault), reason=reason, slipped=correction.slip)


def _of_pair(alignment: FrameAlignment, trajectories: Mapping[str, Trajectory], log: WirelessLog) -> RadioInputs:
    pair = alignment.robot_a, alignment.robot_b
    return {robot: trajectories[robot] for robot in pair}, between(log, {pair})[pair]


def between(log: WirelessLog, pairs: Collection[tuple[str, str]]) -> dict[tuple[str, str], WirelessLog]:
    """By two robots, what they measured of each other, and their headings."""
    measured: dict[tuple[str, str], list[WirelessMeasurement]] = {pair: [] for pair in pairs}
    for m in log.measurements:
        for pair in ((m.receiver, m.transmitter), (m.transmitter, m.receiver)):
            if pair in measured:
                measured[pair].append(m)
    headings: dict[str, list[Heading]] = {}
    for heading in log.headings:
        headings.setdefault(heading.robot, []).append(heading)
    return {
        (a, b): WirelessLog(tuple(own), tuple(h for robot in (a, b) for h in headings.get(robot, ())))
        for (a, b), own in measured.items()
    }


def _links(inputs: RadioInputs, settings: AlignmentSettings) -> Links:
    trajectories, log = inputs
    (links,) = TeamLinks.of(trajectories, log, GatheringLimits.of(settings)).by_pair.values()
    return links


def _aligned(inputs: RadioInputs, settings: AlignmentSettings) -> FrameAlignment:
    return align(_links(inputs, settings), inputs[0], settings)


def _gain(claimed: FrameAlignment, correction: Correction, corrected: FrameAlignment) -> float:
    """By how much more a correction explains (natural logarithm of odds); -inf where it does not explain enough."""
    if corrected.best is None or claimed.best is None:
        return -np.inf
    if corrected.suspected_fault or (corrected.ambiguous and not correction.leaves_out):
        return -np.inf
    ranges = 0 if corrected.fit is None else int(corrected.fit.agreeing_ranges.sum())
    gained = corrected.best.log_likelihood - claimed.best.log_likelihood - (corrected.strain - claimed.strain) / 2
    return gained + ranges * correction.log_scale + correction.log_prior


def _constant_errors(T_a_b: FloatArray, inputs: RadioInputs, settings: AlignmentSettings) -> list[Correction]:
    """Offsets of azimuths and ranges that many residuals of an alignment share."""
    links = _links(inputs, settings)
    a_in_b = se3.transform(se3.inverse(T_a_b), links.antenna_a)
    seen = np.where(
        links.a_receives[:, None], se3.transform(T_a_b, links.antenna_b) - links.antenna_a, a_in_b - links.antenna_b
    )
    found = []
    there = links.path >= 0
    if there.any():
        in_axes = np.einsum("mji,mj->mi", links.R_odom_axes, seen)
        off = se3.wrap_angle(links.azimuth - np.arctan2(in_axes[:, 1], in_axes[:, 0])[:, None])
        angle = float(np.angle(mode(np.exp(1j * off[there]), _WIDTH_RAD)))
        if abs(angle) > _LEAST_OFF_RAD:
            found.append(azimuths_off(angle))
    ranged = links.has_range
    if ranged.any():
        bias = float(mode((links.range_m - np.linalg.norm(seen, axis=1))[ranged], _WIDTH_M))
        found += [ranges_off(sign * max(abs(bias), 3 * _LEAST_OFF_M)) for sign in (1.0, -1.0)]
    return found
