"""Bearings held against odometry: which way they turn, in which axes, from where they count."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure.pipeline.radio.check.finding import Finding
from wiclosure.pipeline.radio.check.geometry import PairSamples
from wiclosure.pipeline.radio.check.range_fit import RangeFit
from wiclosure.types import FloatArray, Trajectory

_WITHIN_S = 3.0  # between two bearings whose difference is held against the turn
_TURN_RAD = 0.15  # turns below say nothing beside the noise of bearings
_FEWEST = 10
_CLEARER = 0.7  # an explanation must leave at most so much of the next one's residual
_CONCENTRATED = 0.5  # mean resultant length of directions that agree
_QUARTERS = {0: "forward", 1: "left", 2: "back", 3: "right"}


def check_bearings(
    samples: PairSamples, trajectories: Mapping[str, Trajectory], fit: RangeFit | None, shift_ns: int = 0
) -> list[Finding]:
    """Handedness and axes by how bearings change while the receiver turns, the zero by where ranges say the other is.

    A bearing in the body's axes falls by as much as the body turns left; one in fixed axes stays; one that counts
    clockwise rises.
    """
    samples = samples.select(np.isfinite(samples.azimuths_rad) & samples.covered(trajectories, shift_ns))
    turns, changes = _turns(samples, trajectories, shift_ns)
    pair = samples.robots
    if len(turns) < _FEWEST:
        if not len(samples.azimuths_rad):
            return []
        text = f"the robots turned too little between bearings to tell which way they count ({len(turns)} turns)"
        return [Finding("bearing", "note", text, pair), *_zero(samples, trajectories, fit, 1, shift_ns)]
    residuals = {slope: _spread(changes - slope * turns) for slope in (-1, 0, 1)}
    best, second = sorted(residuals, key=lambda slope: residuals[slope])[:2]
    told = f"over {len(turns)} turns the bearings change by {_slope_words(best)} (off by {residuals[best]:.2g} rad"
    told += f" in the median, {residuals[second]:.2g} rad if they changed by {_slope_words(second)})"
    if residuals[best] > _CLEARER * residuals[second]:
        text = f"too noisy to tell which way bearings count: {told}"
        return [Finding("bearing", "note", text, pair)]
    if best == -1:
        return [
            Finding("bearing", "good", f"bearings count to the left: {told}", pair),
            *_zero(samples, trajectories, fit, 1, shift_ns),
        ]
    if best == 0:
        text = f"bearings are in fixed axes, not in the body's: {told}"
        return [Finding("bearing", "suspect", text, pair, {"aoa_frame": "odometry"})]
    found = Finding("bearing", "suspect", f"bearings count clockwise: {told}", pair, {"clockwise": True})
    return [found, *_zero(samples, trajectories, fit, -1, shift_ns)]


def _slope_words(slope: int) -> str:
    return {-1: "as much against the turn", 0: "nothing with the turn", 1: "as much with the turn"}[slope]


def _turns(
    samples: PairSamples, trajectories: Mapping[str, Trajectory], shift_ns: int
) -> tuple[FloatArray, FloatArray]:
    """How far the receiver turned between two bearings that follow each other, and how the bearing changed; radians."""
    turns, changes = [np.empty(0)], [np.empty(0)]
    for robot, received in zip(samples.robots, (samples.a_received, ~samples.a_received), strict=True):
        own = samples.select(received)
        if len(own.stamps_ns) < 2:
            continue
        yaw = _yaw(trajectories[robot].at(own.stamps_ns + shift_ns))
        near = np.diff(own.stamps_ns) * 1e-9 < _WITHIN_S
        turn, change = _wrapped(np.diff(yaw)), _wrapped(np.diff(own.azimuths_rad))
        chosen = near & (np.abs(turn) > _TURN_RAD)
        turns.append(turn[chosen])
        changes.append(change[chosen])
    return np.concatenate(turns), np.concatenate(changes)


def _zero(
    samples: PairSamples, trajectories: Mapping[str, Trajectory], fit: RangeFit | None, sense: int, shift_ns: int
) -> list[Finding]:
    """Where azimuth 0 points, by the directions in which the ranges' fit has the other robot."""
    if fit is None or len(samples.azimuths_rad) < _FEWEST:
        return []
    a, b = samples.antennas(trajectories, shift_ns)
    c, s = np.cos(fit.yaw), np.sin(fit.yaw)
    R_a_b = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    to_b = b @ R_a_b.T + fit.translation - a
    yaw_a = _yaw(trajectories[samples.robots[0]].at(samples.stamps_ns + shift_ns))
    yaw_b = _yaw(trajectories[samples.robots[1]].at(samples.stamps_ns + shift_ns)) + fit.yaw
    expected = np.where(
        samples.a_received,
        np.arctan2(to_b[:, 1], to_b[:, 0]) - yaw_a,
        np.arctan2(-to_b[:, 1], -to_b[:, 0]) - yaw_b,
    )
    mean = np.mean(np.exp(1j * (expected - sense * samples.azimuths_rad)))
    offset, agreement = float(np.angle(mean)), float(np.abs(mean))
    pair = samples.robots
    if agreement < _CONCENTRATED:
        text = (
            "bearings scatter too much about the directions that the ranges give to tell where azimuth 0 points"
            f" (agreement {agreement:.2f} of 1, {_CONCENTRATED} needed)"
        )
        return [Finding("bearing", "note", text, pair)]
    quarter = round(offset / (np.pi / 2)) % 4
    degrees = np.degrees(offset)
    if quarter == 0:
        return [
            Finding("bearing", "good", f"azimuth 0 is forward, as far as ranges tell ({degrees:+.0f} degrees)", pair)
        ]
    text = f"azimuth 0 is {degrees:+.0f} degrees from forward, by the directions that the ranges give"
    if abs(offset - np.pi / 2 * (quarter if quarter < 3 else -1)) > np.radians(25) and quarter != 2:
        return [Finding("bearing", "suspect", f"{text}: the antenna is turned", pair)]
    return [Finding("bearing", "suspect", text, pair, {"azimuth_zero": _QUARTERS[quarter]})]


def _yaw(poses: FloatArray) -> FloatArray:
    return np.asarray(Rotation.from_matrix(poses[:, :3, :3]).as_euler("ZYX")[:, 0])


def _wrapped(angles: FloatArray) -> FloatArray:
    return np.asarray((angles + np.pi) % (2 * np.pi) - np.pi)


def _spread(angles: FloatArray) -> float:
    return float(np.median(np.abs(_wrapped(angles))))
