"""What the robots heard of each other for the page: ranges and directions against the estimate, over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from wiclosure import se3
from wiclosure.pipeline.report.html.packing import packed
from wiclosure.pipeline.stages.run import RunResult
from wiclosure.types import FloatArray, FrameAlignment, Trajectory, WirelessMeasurement

MEASUREMENTS = 2_000
PATHS = 8


def radio_pairs(result: RunResult, origin: np.ndarray[Any, Any]) -> list[dict[str, Any]]:
    """One entry for each pair of robots of which the radio says anything."""
    return [_pair(result, alignment, origin) for alignment in result.solution.filtered.alignments]


def _pair(result: RunResult, alignment: FrameAlignment, origin: np.ndarray[Any, Any]) -> dict[str, Any]:
    a, b = alignment.robot_a, alignment.robot_b
    heard = [
        (row, m) for row, m in enumerate(result.inputs.wireless.measurements) if {m.receiver, m.transmitter} == {a, b}
    ]
    step = max(1, -(-len(heard) // MEASUREMENTS))
    heard = heard[::step]
    certainty = "certain" if not alignment.ambiguous else "not certain"
    return {
        "a": a,
        "b": b,
        "says": f"Alignment {certainty}: {alignment.reason}.",
        "sigma": _sigma(alignment),
        "alternatives": _alternatives(alignment),
        **_over_time(result, alignment, heard, origin),
    }


def _sigma(alignment: FrameAlignment) -> dict[str, float] | None:
    if alignment.covariance is None:
        return None
    sigma = np.sqrt(np.diag(alignment.covariance))
    return {
        "yaw_deg": float(np.degrees(sigma[2])),
        **{f"{axis}_m": float(sigma[3 + k]) for k, axis in enumerate("xyz")},
    }


def _alternatives(alignment: FrameAlignment) -> list[dict[str, float]]:
    others = alignment.rivals or (() if alignment.runner_up is None else (alignment.runner_up,))
    if alignment.best is None:
        return []
    found = []
    for other in others:
        between = se3.between(alignment.best.T_a_b, other.T_a_b)
        odds = np.exp(min(alignment.best.log_likelihood - other.log_likelihood, 50.0))
        found.append(
            {
                "odds": float(odds),
                "apart_m": float(np.linalg.norm(between[:3, 3])),
                "turned_deg": float(np.degrees(se3.rotation_angle(between[None])[0])),
            }
        )
    return found


def _over_time(
    result: RunResult,
    alignment: FrameAlignment,
    heard: list[tuple[int, WirelessMeasurement]],
    origin: np.ndarray[Any, Any],
) -> dict[str, Any]:
    stamps_ns = np.array([m.stamp_ns for _, m in heard], np.int64)
    began_ns = min(int(front.odometry.stamps_ns[0]) for front in result.fronts.values())
    where = {robot: _track(result, alignment, robot) for robot in (alignment.robot_a, alignment.robot_b)}
    none = np.full((len(heard), 4, 4), np.nan)
    poses = {robot: none if t is None or not len(heard) else t.at(stamps_ns) for robot, t in where.items()}
    a_receives = np.array([m.receiver == alignment.robot_a for _, m in heard], bool)[:, None, None]
    here, there = (
        np.where(a_receives, poses[x], poses[y])
        for x, y in ((alignment.robot_a, alignment.robot_b), (alignment.robot_b, alignment.robot_a))
    )
    seen = np.einsum("nji,nj->ni", here[:, :3, :3], there[:, :3, 3] - here[:, :3, 3])
    azimuth, kept = _paths(alignment, heard)
    ends = np.stack([here[:, :3, 3], there[:, :3, 3]], axis=1) - origin
    drawn = _same_component(result, alignment) and bool(np.isfinite(ends).all())
    return {
        "times": packed(((stamps_ns - began_ns) * 1e-9).astype(np.float64)),
        "range": packed(np.array([np.nan if m.range_m is None else m.range_m for _, m in heard], np.float32)),
        "estimate": packed(np.linalg.norm(seen, axis=1).astype(np.float32)),
        "direction": packed(np.arctan2(seen[:, 1], seen[:, 0]).astype(np.float32)),
        "azimuth": packed(azimuth.astype(np.float32).ravel()),
        "azimuth_kept": packed(kept.astype(np.uint8).ravel()),
        "ends": packed(ends.astype(np.float32).ravel()) if drawn else None,
    }


def _same_component(result: RunResult, alignment: FrameAlignment) -> bool:
    return any({alignment.robot_a, alignment.robot_b} <= set(c) for c in result.solution.graph.components)


def _track(result: RunResult, alignment: FrameAlignment, robot: str) -> Trajectory | None:
    """Where a robot was: in the merged world, or, if nothing connects the two, as the radio aligns them."""
    if _same_component(result, alignment):
        return result.merged[robot]
    if alignment.best is None:
        return None
    odometry = result.fronts[robot].odometry
    return odometry if robot == alignment.robot_a else odometry.moved(alignment.best.T_a_b)


def _paths(alignment: FrameAlignment, heard: list[tuple[int, WirelessMeasurement]]) -> tuple[FloatArray, FloatArray]:
    """Azimuths in the receiver's body axes `(N, K)`, NaN where there is none or other axes, and which are kept."""
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
