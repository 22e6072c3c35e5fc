"""What a run found: everything in one world, over time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from wiclosure.colours import robot_rgb
from wiclosure.pipeline.report.html.radio_data import antennas
from wiclosure.pipeline.report.html.run_data import tracks_of
from wiclosure.pipeline.report.html.scene_data import MAP_POINTS, Placement
from wiclosure.pipeline.report.viewer import columns
from wiclosure.pipeline.report.viewer.own_frames import BLUE, ORANGE, caption
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import Closure, FloatArray, FrameAlignment, IntArray

SPACE = "map"
POINTS_OF_SCANS = 2_000_000
PREDICTED = (204, 121, 167)


def show_result(recording: rr.RecordingStream, result: RunResult) -> list[str]:
    """Map, robots, closures with predictions, links, and the diagnosis.

    Returns:
        Paths of the entities whose rows stay.
    """
    placement = Placement.of(result.solution.graph.components, result.merged)
    first = placement.offset[result.solution.graph.components[0][0]]
    offset = {robot: own - first for robot, own in placement.offset.items()}  # the map keeps its own coordinates
    _show_map(recording, result)
    keyframes = _show_robots(recording, result, offset)
    closures = _show_closures(recording, result, offset)
    _show_predictions(recording, result, offset)
    for alignment in result.solution.filtered.alignments:
        _show_links(recording, result, alignment, placement, first)
    recording.log("diagnosis", rr.TextDocument(_diagnosis(result), media_type="text/markdown"), static=True)
    return [*keyframes, *closures, f"{SPACE}/predictions"]


def _diagnosis(result: RunResult) -> str:
    """Counts and sentences as Markdown."""
    metrics = result.metrics
    counts = {
        "pairs of keyframes": f"{metrics['pairs_kept']:,} of {metrics['pairs_total']:,} kept by {metrics['filter']}",
        "closures": f"{metrics['closures']['accepted']} of {metrics['closures']['proposed']} accepted",
        "robots in one map": ", ".join(metrics["components"][0]["robots"]),
    }
    if not metrics["pairs_total"]:  # of a lone robot
        del counts["pairs of keyframes"]
    lines = [f"**{name}**: {value}" for name, value in counts.items()]
    return "\n\n".join(lines + [f"- {sentence}" for sentence in metrics["diagnosis"]])


def _show_map(recording: rr.RecordingStream, result: RunResult) -> None:
    merged = result.merged_map
    rows = np.arange(len(merged))
    if len(merged) > MAP_POINTS:
        rows = np.random.default_rng(0).choice(rows, MAP_POINTS, replace=False)
    cloud = rr.Points3D(merged.points[rows], colors=merged.colours[rows], radii=rr.Radius.ui_points(1.0))
    recording.log(f"{SPACE}/points", cloud, static=True)


def _show_robots(recording: rr.RecordingStream, result: RunResult, offset: dict[str, FloatArray]) -> list[str]:
    """Paths, keyframes, and the scan of each keyframe where it was taken; the keyframes' entities."""
    lasting = []
    every = max(1, -(-sum(len(c) for front in result.fronts.values() for c in front.clouds) // POINTS_OF_SCANS))
    for number, (robot, front) in enumerate(result.fronts.items()):
        path, colour = f"{SPACE}/{rr.escape_entity_path_part(robot)}", robot_rgb(number)
        keyframes, scans = result.solution.graph.trajectories[robot], result.merged[robot]
        recording.log(path, rr.Transform3D(translation=offset[robot]), static=True)
        recording.log(f"{path}/path", rr.LineStrips3D([scans.positions], colors=colour), static=True)
        dots = rr.Points3D.from_fields(colors=colour, radii=rr.Radius.ui_points(3))
        recording.log(f"{path}/keyframes", dots, static=True)
        columns.points(recording, f"{path}/keyframes", keyframes.stamps_ns, list(keyframes.positions[:, None]))
        recording.log(f"{path}/body", rr.TransformAxes3D(2.0), static=True)
        columns.poses(recording, f"{path}/body", scans.stamps_ns, scans.poses)
        recording.log(f"{path}/body/scan", rr.Points3D.from_fields(colors=colour), static=True)
        clouds = [cloud[::every] for cloud in front.clouds]
        columns.points(recording, f"{path}/body/scan", keyframes.stamps_ns, clouds)
        lasting.append(f"{path}/keyframes")
    return lasting


def _show_closures(recording: rr.RecordingStream, result: RunResult, offset: dict[str, FloatArray]) -> list[str]:
    """By their fate, each in an entity of its own."""
    groups: dict[str, list[Closure]] = {"accepted": []}
    for closure in result.solution.closures:
        fate = "accepted" if closure.rejected_at is None else f"rejected/{closure.rejected_at.name.lower()}"
        groups.setdefault(fate, []).append(closure)
    for fate, group in groups.items():
        path = f"{SPACE}/closures/{fate}"
        colour = BLUE if fate == "accepted" else ORANGE
        recording.log(path, rr.LineStrips3D.from_fields(colors=colour, show_labels=False), static=True)
        stamps_ns, query, match = _places(result, group, offset)
        ends = np.stack([query[:, :3, 3], match[:, :3, 3]], axis=1)
        columns.lines(recording, path, stamps_ns, ends, [caption(closure) for closure in group])
    return [f"{SPACE}/closures/{fate}" for fate in groups]


def _show_predictions(recording: rr.RecordingStream, result: RunResult, offset: dict[str, FloatArray]) -> None:
    """Where the filter expected each proposed match, one standard deviation around it."""
    predicted = [c for c in result.solution.closures if c.prediction is not None]
    known = [c.prediction for c in predicted if c.prediction is not None]
    stamps_ns, query, _ = _places(result, predicted, offset)
    T_query_match = np.array([p.T_query_match for p in known]).reshape(-1, 4, 4)
    covariance = np.array([p.covariance for p in known]).reshape(-1, 6, 6)
    path = f"{SPACE}/predictions"
    recording.log(path, rr.Ellipsoids3D.from_fields(colors=PREDICTED, fill_mode="majorwireframe"), static=True)
    columns.ellipsoids(recording, path, stamps_ns, query @ T_query_match, covariance)


def _places(
    result: RunResult, closures: Sequence[Closure], offset: dict[str, FloatArray]
) -> tuple[IntArray, FloatArray, FloatArray]:
    """When both keyframes were there, ns `(N,)`, and poses `(N, 4, 4)` of query and match, as drawn."""
    keyframes = result.solution.graph.trajectories
    drawn = {robot: path.poses.copy() for robot, path in keyframes.items()}
    for robot, poses in drawn.items():
        poses[:, :3, 3] += offset[robot]
    stamps = [max(keyframes[k.robot].stamps_ns[k.index] for k in (c.query, c.match)) for c in closures]
    ends = [[drawn[k.robot][k.index] for k in (c.query, c.match)] for c in closures]
    both = np.array(ends, float).reshape(-1, 2, 4, 4)
    return np.array(stamps, np.int64), both[:, 0], both[:, 1]


def _show_links(
    recording: rr.RecordingStream, result: RunResult, alignment: FrameAlignment, placement: Placement, first: FloatArray
) -> None:
    """Measurements of two robots: lines between the antennas, and ranges measured and by the estimate."""
    pair = {alignment.robot_a, alignment.robot_b}
    heard = sorted(
        (m for m in result.inputs.wireless.measurements if {m.receiver, m.transmitter} == pair),
        key=lambda m: m.stamp_ns,
    )
    if not heard:
        return
    tracks, name = tracks_of(result, alignment, placement), f"{alignment.robot_a}-{alignment.robot_b}"
    stamps_ns = np.array([m.stamp_ns for m in heard], np.int64)
    a_receives = np.array([m.receiver == alignment.robot_a for m in heard], bool)
    here, there = (poses[:, :3, 3] for poses in antennas(alignment, heard, a_receives, tracks))
    path = rr.escape_entity_path_part(name)
    if tracks.offset is not None:
        ends = np.stack([here, there], axis=1) + tracks.offset - first
        known = np.isfinite(ends).all(axis=(1, 2))
        recording.log(f"{SPACE}/links/{path}", rr.LineStrips3D.from_fields(colors=(0, 158, 115)), static=True)
        columns.lines(recording, f"{SPACE}/links/{path}", stamps_ns[known], ends[known])
    measured = np.array([np.nan if m.range_m is None else m.range_m for m in heard])
    columns.scalars(recording, f"radio/{path}/range/measured", stamps_ns, measured)
    columns.scalars(recording, f"radio/{path}/range/estimate", stamps_ns, np.linalg.norm(there - here, axis=1))
