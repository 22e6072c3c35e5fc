"""What the page shows of one run, as a JSON document."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from wiclosure import __version__
from wiclosure.backends.merged_map import ROBOT_COLOURS, MergedMap
from wiclosure.pipeline.config import dump_config
from wiclosure.pipeline.report.html.candidates_data import candidate_matrices
from wiclosure.pipeline.report.html.closures_data import closure_rows, scans_of_closures, stages_with_reasons
from wiclosure.pipeline.report.html.packing import packed, packed_points
from wiclosure.pipeline.report.html.radio_data import radio_pairs
from wiclosure.pipeline.report.html.tables_data import figure_tables
from wiclosure.pipeline.report.pictures import robot_colour
from wiclosure.pipeline.stages.run import RunResult
from wiclosure.types import Trajectory

MAP_POINTS = 300_000
_PACKAGES = ("numpy", "scipy", "gtsam", "kiss-icp", "small-gicp", "open3d", "rosbags")


def run_data(result: RunResult, name: str) -> dict[str, Any]:
    """Everything that the page shows of a run.

    Args:
        result: the run.
        name: of the run or arm.
    """
    metrics, origin = result.metrics, _origin(result)
    return {
        "id": name,
        "name": name,
        "robots": [_robot(result, number, robot, origin) for number, robot in enumerate(result.fronts)],
        "map": _map(result.merged_map, origin, len(result.fronts)),
        "map_note": _map_note(result),
        "closures": closure_rows(result, origin),
        **scans_of_closures(result),
        "funnel": stages_with_reasons(metrics["funnel"], result.solution.closures),
        "matrices": candidate_matrices(result),
        "radio": radio_pairs(result, origin),
        "seconds": metrics["seconds"],
        "bytes_exchanged": metrics["bytes_exchanged"],
        "peak_rss_mb": metrics["peak_rss_mb"],
        "tables": figure_tables(metrics),
        "metrics": metrics,
        "config": dump_config(result.config),
        "versions": _versions(),
    }


def _origin(result: RunResult) -> np.ndarray[Any, Any]:
    """A point near the map: single precision holds centimetres there, however large the coordinates are."""
    return np.asarray(np.round(next(iter(result.merged.values())).positions.mean(axis=0)))


def _robot(result: RunResult, number: int, robot: str, origin: np.ndarray[Any, Any]) -> dict[str, Any]:
    front, merged = result.fronts[robot], result.merged[robot]
    keyframes = result.solution.graph.trajectories[robot]
    truth = result.inputs.ground_truth.get(robot)
    began_ns = int(front.odometry.stamps_ns[0])
    own = front.odometry.positions - front.odometry.positions[0]
    beside = np.array([0.0, -1.2 * number * max(float(np.ptp(own[:, 1])), 10.0), 0.0])
    return {
        "name": robot,
        "colour": robot_colour(number),
        "connected": robot in result.solution.graph.components[0],
        "merged": packed(_thinned(merged.positions - origin).astype(np.float32)),
        "odometry": packed(_thinned(own + beside).astype(np.float32)),
        "keyframes": packed((keyframes.positions - origin).astype(np.float32)),
        "keyframe_times": packed(((keyframes.stamps_ns - began_ns) * 1e-9).astype(np.float32)),
        "truth": None if truth is None else _truth(result, robot, truth, origin),
    }


def _truth(result: RunResult, robot: str, truth: Trajectory, origin: np.ndarray[Any, Any]) -> dict[str, Any] | None:
    """Ground truth laid over the merged trajectories of the robot's component."""
    from wiclosure.pipeline.evaluation.errors import matched, rigid_alignment

    component = next(c for c in result.solution.graph.components if robot in c)
    gap_s = result.config.evaluation.ground_truth_gap_s
    pairs = [matched(result.merged[r], result.inputs.ground_truth.get(r), gap_s) for r in component]
    pairs = [pair for pair in pairs if len(pair)]
    if not pairs:
        return None
    estimate, true = (np.concatenate([getattr(p, side)[:, :3, 3] for p in pairs]) for side in ("estimate", "truth"))
    T_world_truth = rigid_alignment(true, estimate)
    placed = truth.positions @ T_world_truth[:3, :3].T + T_world_truth[:3, 3] - origin
    return packed(_thinned(placed).astype(np.float32))


def _thinned(positions: np.ndarray[Any, Any], most: int = 5_000) -> np.ndarray[Any, Any]:
    """At most so many of a path's positions, evenly, both ends among them."""
    if len(positions) <= most:
        return positions
    return positions[np.linspace(0, len(positions) - 1, most).round().astype(np.int64)]


def _map(merged: MergedMap, origin: np.ndarray[Any, Any], robots: int) -> dict[str, Any] | None:
    """At most 300,000 points, those of a random but fixed choice, with the robot that each is mostly of."""
    if len(merged) == 0:
        return None
    rng = np.random.default_rng(0)
    rows = np.arange(len(merged)) if len(merged) <= MAP_POINTS else rng.choice(len(merged), MAP_POINTS, replace=False)
    points = packed_points(merged.points[rows] - origin.astype(np.float32))
    order = points.pop("order")
    palette = ROBOT_COLOURS[: min(robots, len(ROBOT_COLOURS))].astype(int)
    apart = ((merged.colours[rows][order].astype(int)[:, None] - palette) ** 2).sum(axis=2)
    heights = np.quantile(merged.points[rows, 2] - origin[2], [0.02, 0.98])
    share = (heights - points["min"][2]) / points["extent"][2]
    return {
        **points,
        "robot": packed(apart.argmin(axis=1).astype(np.uint8)),
        "colours": [robot_colour(k) for k in range(len(palette))],
        "heights": [float(share[0]), float(max(share[1], share[0] + 1e-3))],
        "shown": len(rows),
        "of": len(merged),
    }


def _map_note(result: RunResult) -> str:
    unconnected = result.solution.graph.unconnected
    notes = []
    if len(result.merged_map) > MAP_POINTS:
        notes.append(f"{MAP_POINTS:,} of the map's {len(result.merged_map):,} points are drawn; map.ply holds all.")
    if unconnected:
        notes.append(f"Not connected, drawn in a frame of its own: {', '.join(unconnected)}. The map is without it.")
    return " ".join(notes)


def _versions() -> dict[str, str]:
    found = {"wiclosure": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found
