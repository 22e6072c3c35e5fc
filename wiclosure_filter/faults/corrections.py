"""The blunders that are made with radios and odometry, each as the correction that would undo it.

A log can be wrong as a whole and look right line by line: angles that run clockwise, ranges in feet, clocks that
differ.  A correction turns the trajectories and the log of two robots into those that would have been right.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from wiclosure import se3
from wiclosure.types import AoaFrame, FloatArray, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.alignment.indistinguishable import Blunder

RadioInputs: TypeAlias = tuple[Mapping[str, Trajectory], WirelessLog]
_Measurement: TypeAlias = WirelessMeasurement

_CLOCKS_S = (0.5, 2.0)  # the rest is estimated from there
_FITTED = float(np.log(0.05))
_SCALES = (0.9, 1.1)
_UNITS_M = {"feet": 0.3048, "centimetres": 0.01, "millimetres": 0.001}
_WIDEST_RAD = 0.35  # a bearing that may be further off tells nothing, and agrees with everything
_Y_RIGHT = np.diag([1.0, -1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Correction:
    """What would undo a systematic error.

    Args:
        fault: the error, as a sentence without its end.
        apply: corrected trajectories and log.
        log_scale: natural logarithm of the factor on every range: densities over ranges are compared in one unit.
        log_prior: natural logarithm of how likely it is beside the others; an offset that was fitted could be any.
        whole_log: true for conventions and units: whoever wrote the log wrote all of it so.
        slip: true where links before and after are to be aligned on their own instead.
        of_log: true where the log alone is corrected; odometry that is wrong must be corrected where it is made.
        leaves_out: true where measurements are left out: what is left need not tell an alignment.
        mirrored: true where a robot moves as in a mirror, as its image in a wall does too.
    """

    fault: str
    apply: Callable[[RadioInputs], RadioInputs]
    of_log: bool = True
    log_scale: float = 0.0
    log_prior: float = 0.0
    whole_log: bool = False
    slip: bool = False
    leaves_out: bool = False
    mirrored: bool = False


def corrections(robot_a: str, robot_b: str, log: WirelessLog) -> list[Correction]:
    """All that are tried for two robots, of whose measurements `log` tells."""
    possible = [*_of_odometry(robot_a), *_of_odometry(robot_b), *_of_clocks(robot_a, robot_b)]
    possible.append(swapped({robot_a: robot_b, robot_b: robot_a}))
    possible += [replace(sigmas_too_small(factor), whole_log=True) for factor in (3.0, 10.0)]
    if log.headings:
        possible.append(_without_compasses())
    ranged, directed = any(m.range_m is not None for m in log.measurements), any(m.paths for m in log.measurements)
    if ranged and directed:
        possible += _without_one_kind()
    if ranged:
        possible += [replace(_ranges_in(unit, metres), whole_log=True) for unit, metres in _UNITS_M.items()]
    if directed:
        possible += [replace(convention, whole_log=True) for convention in _of_azimuths(log)]
    return possible


def undone(blunder: Blunder, robot_a: str, robot_b: str) -> Correction:
    """What undoes a blunder that two robots' measurements cannot tell from none."""
    if blunder.swapped:
        return swapped({robot_a: robot_b, robot_b: robot_a})
    if not blunder.compasses:
        return _without_compasses()
    turned = _azimuths(blunder.clause, blunder.sign, blunder.offset_rad)
    scaled = _each(
        blunder.clause, lambda m: m if m.range_m is None else replace(m, range_m=blunder.range_scale * m.range_m)
    )
    return replace(turned, apply=lambda inputs: scaled.apply(turned.apply(inputs)))


def azimuths_off(angle_rad: float) -> Correction:
    """Of azimuths that are too large by an angle, as those of an antenna array that is mounted turned."""
    side = f"{abs(np.degrees(angle_rad)):.0f} degrees {'counter-clockwise' if angle_rad > 0 else 'clockwise'}"
    turned = _azimuths(f"azimuths are off by {side}: the antenna array seems to be mounted turned", 1.0, -angle_rad)
    return replace(turned, log_prior=_FITTED)


def ranges_off(bias_m: float) -> Correction:
    """Of ranges that are too long throughout, as those of antennas with an uncalibrated delay."""
    side = "long" if bias_m > 0 else "short"
    shifted = _each(
        f"ranges are {abs(bias_m):.1f} m too {side}: the antenna delay seems not to be calibrated",
        lambda m: m if m.range_m is None else replace(m, range_m=max(m.range_m - bias_m, 0.0)),
    )
    return replace(shifted, log_prior=_FITTED)


def slipped(since_s: float, until_s: float) -> Correction:
    """Of odometry that slips between two times after the first measurement."""
    fault = f"odometry seems to slip, or a robot was moved, between {since_s:.0f} s and {until_s:.0f} s after the first"
    return Correction(f"{fault} measurement", lambda inputs: inputs, of_log=False, slip=True)


def clocks_apart(robot_b: str, ahead_s: float) -> Correction:
    """Of measurements between robots of which b's clock is ahead."""
    ahead_ns = round(ahead_s * 1e9)

    def shifted(m: _Measurement) -> _Measurement:
        sent_ns = m.stamp_ns if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns
        return replace(m, transmitter_stamp_ns=sent_ns + (ahead_ns if m.transmitter == robot_b else -ahead_ns))

    side = "ahead" if ahead_s > 0 else "behind"
    return _each(f"the clock of {robot_b} seems to be about {abs(ahead_s):g} s {side}", shifted)


def odometry_clock_off(robot: str, ahead_s: float) -> Correction:
    """Of one robot's odometry, stamped by a clock that is ahead of the log's."""
    ahead_ns = round(ahead_s * 1e9)

    def shifted(inputs: RadioInputs) -> RadioInputs:
        trajectories, log = inputs
        one = trajectories[robot]
        finer = None if one.finer is None else replace(one.finer, stamps_ns=one.finer.stamps_ns - ahead_ns)
        return {**trajectories, robot: replace(one, stamps_ns=one.stamps_ns - ahead_ns, finer=finer)}, log

    side = "ahead of" if ahead_s > 0 else "behind"
    return Correction(f"{robot}'s odometry would be {abs(ahead_s):.0f} s {side} the log", shifted, of_log=False)


def swapped(names: Mapping[str, str]) -> Correction:
    """Of robots' names that are mixed up in the log; by the name that each should have."""
    mixed = ", ".join(f"{wrong} for {right}" for wrong, right in names.items() if wrong != right)

    def renamed(inputs: RadioInputs) -> RadioInputs:
        trajectories, log = inputs
        measurements = tuple(
            replace(m, receiver=names.get(m.receiver, m.receiver), transmitter=names.get(m.transmitter, m.transmitter))
            for m in log.measurements
        )
        headings = tuple(replace(h, robot=names.get(h.robot, h.robot)) for h in log.headings)
        return trajectories, replace(log, measurements=measurements, headings=headings)

    return Correction(f"the robots' names seem to be swapped in the log ({mixed})", renamed)


def sigmas_too_small(factor: float) -> Correction:
    """Of standard deviations that the log states too small."""

    def widened(m: _Measurement) -> _Measurement:
        sigma = None if m.range_sigma_m is None else factor * m.range_sigma_m
        paths = tuple(replace(p, sigma=max(p.sigma, min(factor * p.sigma, _WIDEST_RAD))) for p in m.paths)
        return replace(m, range_sigma_m=sigma, paths=paths)

    return _each(f"standard deviations seem to be about {factor:g} times too small", widened)


def _of_azimuths(log: WirelessLog) -> list[Correction]:
    right = np.pi / 2
    possible = [
        _azimuths("azimuths seem to run clockwise, not counter-clockwise", -1.0, 0.0),
        _azimuths("azimuths seem to be taken from the left axis, not from x forward", 1.0, right),
        _azimuths("azimuths seem to be taken from the right axis, not from x forward", 1.0, -right),
        _azimuths("azimuths seem to be reversed: they point away from the transmitter", 1.0, np.pi),
        _azimuths("azimuths seem to run clockwise from the left axis", -1.0, right),
        _azimuths("azimuths seem to run clockwise from the right axis", -1.0, -right),
        _azimuths("azimuths seem to run clockwise and to be reversed", -1.0, np.pi),
    ]
    stated = {m.aoa_frame for m in log.measurements if m.paths}
    frames: tuple[AoaFrame, ...] = ("body", "odometry")
    for frame in frames:
        if stated != {frame}:
            possible.append(_azimuths_in(frame, stated))
    return possible


def _azimuths_in(frame: AoaFrame, stated: set[AoaFrame]) -> Correction:
    return _each(
        f"azimuths seem to be in {frame} axes, not in {' and '.join(sorted(stated))} axes (aoa_frame)",
        lambda m: replace(m, aoa_frame=frame),
    )


def _without_one_kind() -> list[Correction]:
    """Of azimuths or ranges that tell nothing, whatever they are taken for."""
    return [
        _left_with(
            "azimuths contradict ranges and odometry, from whatever axis they run: are they in radians?",
            lambda log: [replace(m, paths=()) for m in log if m.range_m is not None],
        ),
        _left_with(
            "ranges contradict azimuths and odometry, whatever their unit",
            lambda log: [replace(m, range_m=None, range_sigma_m=None) for m in log if m.paths],
        ),
    ]


def _left_with(fault: str, left: Callable[[Sequence[_Measurement]], list[_Measurement]]) -> Correction:
    return Correction(
        fault,
        lambda inputs: (inputs[0], replace(inputs[1], measurements=tuple(left(inputs[1].measurements)))),
        whole_log=True,
        leaves_out=True,
    )


def _without_compasses() -> Correction:
    return Correction(
        "headings of the compasses contradict the measured ranges and bearings",
        lambda inputs: (inputs[0], replace(inputs[1], headings=())),
    )


def _of_odometry(robot: str) -> list[Correction]:
    mirrored = Correction(
        f"odometry of {robot} seems to have y to the right (left-handed axes, or NED), or what was heard of it is its"
        " image in a wall",
        lambda inputs: _moved(inputs, robot, _mirrored),
        of_log=False,
        mirrored=True,
    )
    return [mirrored, *(_scaled(robot, factor) for factor in _SCALES)]


def _of_clocks(robot_a: str, robot_b: str) -> list[Correction]:
    return [clocks_apart(robot_b, sign * seconds) for seconds in _CLOCKS_S for sign in (1.0, -1.0)]


def _scaled(robot: str, factor: float) -> Correction:
    def scale(poses: FloatArray) -> FloatArray:
        poses = poses.copy()
        poses[:, :3, 3] = poses[0, :3, 3] + factor * (poses[:, :3, 3] - poses[0, :3, 3])
        return poses

    side = "long" if factor < 1 else "short"
    return Correction(
        f"odometry of {robot} seems to be about {100 * abs(1 / factor - 1):.0f} % too {side}",
        lambda inputs: _moved(inputs, robot, scale),
        of_log=False,
    )


def _ranges_in(unit: str, metres: float) -> Correction:
    def converted(m: _Measurement) -> _Measurement:
        return m if m.range_m is None else replace(m, range_m=metres * m.range_m)

    return replace(_each(f"ranges seem to be in {unit}, not in metres", converted), log_scale=float(np.log(metres)))


def _azimuths(fault: str, sign: float, offset_rad: float) -> Correction:
    def turned(m: _Measurement) -> _Measurement:
        azimuths = [float(se3.wrap_angle(np.asarray(sign * p.azimuth + offset_rad))) for p in m.paths]
        return replace(m, paths=tuple(replace(p, azimuth=a) for p, a in zip(m.paths, azimuths, strict=True)))

    return _each(fault, turned)


def _each(fault: str, change: Callable[[_Measurement], _Measurement]) -> Correction:
    """Of every measurement."""
    return Correction(
        fault, lambda inputs: (inputs[0], replace(inputs[1], measurements=tuple(map(change, inputs[1].measurements))))
    )


def _moved(inputs: RadioInputs, robot: str, change: Callable[[FloatArray], FloatArray]) -> RadioInputs:
    trajectories, log = inputs
    one = trajectories[robot]
    finer = None if one.finer is None else replace(one.finer, poses=change(one.finer.poses))
    return {**trajectories, robot: replace(one, poses=change(one.poses), finer=finer)}, log


def _mirrored(poses: FloatArray) -> FloatArray:
    poses = poses.copy()
    poses[:, :3, :3] = _Y_RIGHT @ poses[:, :3, :3] @ _Y_RIGHT
    poses[:, :3, 3] = poses[:, :3, 3] @ _Y_RIGHT
    return poses
