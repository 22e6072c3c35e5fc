"""What the robots heard of each other for the page: ranges and directions against the estimate, over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from wiclosure import se3
from wiclosure.arrays import BoolArray
from wiclosure.pipeline.report.html.packing import packed_bytes, packed_steps
from wiclosure.types import FloatArray, FrameAlignment, Trajectory, WirelessLog, WirelessMeasurement

MEASUREMENTS = 2_000
MEASUREMENTS_OF_ALL = 30_000
PATHS = 8
MOST_LOG_ODDS = 50.0
_NEAR_NS = 10**9  # beyond its ends a path still tells where the robot was

Heard: TypeAlias = list[tuple[int, WirelessMeasurement]]
"""Measurements of two robots with their rows in the log."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """Where two robots were, in one frame.

    Args:
        a, b: their paths; None where nothing tells.
        offset: `(3,)` m to add for the 3-D view; None: they are not drawn there in one frame.
    """

    a: Trajectory | None
    b: Trajectory | None
    offset: FloatArray | None


def radio_pair(
    alignment: FrameAlignment, wireless: WirelessLog, tracks: Tracks, *, began_ns: int, of_pairs: int = 1
) -> dict[str, Any]:
    """What two robots measured of each other.

    Args:
        alignment: what the filter made of it.
        wireless: the log.
        tracks: the estimate.
        began_ns: time zero of the page.
        of_pairs: how many pairs of robots share the page.
    """
    a, b = alignment.robot_a, alignment.robot_b
    heard = [(row, m) for row, m in enumerate(wireless.measurements) if {m.receiver, m.transmitter} == {a, b}]
    heard.sort(key=lambda entry: entry[1].stamp_ns)
    most = max(100, min(MEASUREMENTS, MEASUREMENTS_OF_ALL // of_pairs))
    shown = heard[:: max(1, -(-len(heard) // most))]
    return {
        "a": a,
        "b": b,
        "certain": not alignment.ambiguous,
        "reason": alignment.reason,
        "measured": len(heard),
        "sigma": _sigma(alignment),
        "alternatives": alternatives(alignment),
        **_over_time(alignment, shown, tracks, began_ns),
    }


def _sigma(alignment: FrameAlignment) -> dict[str, float] | None:
    if alignment.covariance is None:
        return None
    sigma = np.sqrt(np.diag(alignment.covariance))
    return {
        "yaw_deg": float(np.degrees(sigma[2])),
        **{f"{axis}_m": float(sigma[3 + k]) for k, axis in enumerate("xyz")},
    }


def alternatives(alignment: FrameAlignment) -> list[dict[str, float]]:
    """Other ways in which the two frames may lie: odds of the best against each, and how far it is from the best."""
    if alignment.best is None:
        return []
    others = alignment.likely_alternatives or (
        () if alignment.best_alternative is None else (alignment.best_alternative,)
    )
    found = []
    for other in others:
        between = se3.between(alignment.best.T_a_b, other.T_a_b)
        log_odds = alignment.best.log_likelihood - other.log_likelihood
        found.append(
            {
                "odds": float(np.exp(min(log_odds, MOST_LOG_ODDS))),
                "apart_m": float(np.linalg.norm(between[:3, 3])),
                "turned_deg": float(np.degrees(se3.rotation_angle(between[None])[0])),
            }
        )
    return found


def _over_time(alignment: FrameAlignment, heard: Heard, tracks: Tracks, began_ns: int) -> dict[str, Any]:
    stamps_ns = np.array([m.stamp_ns for _, m in heard], np.int64)
    a_receives = np.array([m.receiver == alignment.robot_a for _, m in heard], bool)
    here, there = antennas(alignment, [m for _, m in heard], a_receives, tracks)
    seen = np.einsum("nji,nj->ni", here[:, :3, :3], there[:, :3, 3] - here[:, :3, 3])
    azimuth, kept = _paths(alignment, heard)
    ends = np.concatenate([here[:, :3, 3], there[:, :3, 3]], axis=1)
    known = np.isfinite(ends).all(axis=1)
    if tracks.offset is not None and known.any():
        ends[~known] = np.tile(ends[known][0, :3], 2)  # without length, so that they are not seen
        ends += np.tile(tracks.offset, 2)
    return {
        "times": packed_steps((stamps_ns - began_ns) * 1e-9, 1e-3),
        "a_receives": packed_bytes(a_receives),
        "range": packed_steps(np.array([np.nan if m.range_m is None else m.range_m for _, m in heard]), 1e-3),
        "estimate": packed_steps(np.linalg.norm(seen, axis=1), 1e-3),
        "direction": packed_steps(np.degrees(np.arctan2(seen[:, 1], seen[:, 0])), 0.01),
        "paths": azimuth.shape[1],
        "azimuth": packed_steps((np.degrees(azimuth) + 180.0) % 360.0 - 180.0, 0.01),
        "azimuth_kept": packed_bytes(kept),
        "ends": packed_steps(ends, 0.01) if tracks.offset is not None and known.any() else None,
    }


def antennas(
    alignment: FrameAlignment, heard: Sequence[WirelessMeasurement], a_receives: BoolArray, tracks: Tracks
) -> tuple[FloatArray, FloatArray]:
    """Poses `(N, 4, 4)` of the receiving and the sending antenna, in the axes of the bodies.

    NaN where they are unknown, as before and after the robot's own path.
    """
    track = {alignment.robot_a: tracks.a, alignment.robot_b: tracks.b}
    received_ns = np.array([m.stamp_ns for m in heard], np.int64)
    sent_ns = np.array([m.stamp_ns if m.transmitter_stamp_ns is None else m.transmitter_stamp_ns for m in heard])
    arms = [np.array([m.lever_arm_receiver for m in heard]), np.array([m.lever_arm_transmitter for m in heard])]
    found = []
    for stamps_ns, arm, a_here in zip((received_ns, sent_ns), arms, (a_receives, ~a_receives), strict=True):
        poses = np.full((len(heard), 4, 4), np.nan)
        for robot, rows in ((alignment.robot_a, a_here), (alignment.robot_b, ~a_here)):
            path = track[robot]
            if path is not None and rows.any():
                known = np.flatnonzero(rows)[path.covers(stamps_ns[rows].astype(np.int64), _NEAR_NS)]
                poses[known] = path.at(stamps_ns[known].astype(np.int64))
        poses[:, :3, 3] += np.einsum("nij,nj->ni", poses[:, :3, :3], arm.reshape(-1, 3))
        found.append(poses)
    return found[0], found[1]


def _paths(
    alignment: FrameAlignment, heard: Sequence[tuple[int, WirelessMeasurement]]
) -> tuple[FloatArray, FloatArray]:
    """Azimuths in the receiver's body axes `(N, K)` rad, NaN where there is none or other axes, and which are kept."""
    chosen = set() if alignment.best is None else set(alignment.best.paths_kept)
    most = min(PATHS, max((len(m.paths) for _, m in heard), default=0))
    azimuth, kept = np.full((len(heard), most), np.nan), np.zeros((len(heard), most))
    for n, (row, m) in enumerate(heard):
        if m.aoa_frame != "body":
            continue
        # The kept path comes first, so that it is shown even where there are more than can be.
        ranks = [((row, k) not in chosen, -path.weight, k) for k, path in enumerate(m.paths)]
        for place, (_, _, k) in enumerate(sorted(ranks)[:most]):
            azimuth[n, place], kept[n, place] = m.paths[k].azimuth, (row, k) in chosen
    return azimuth, kept
