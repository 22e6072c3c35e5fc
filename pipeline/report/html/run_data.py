"""What the page shows of one run, as a JSON document."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from wiclosure import se3
from wiclosure.pipeline.config import dump_config
from wiclosure.pipeline.evaluation.body_axes import in_lidar_axes
from wiclosure.pipeline.evaluation.closures import TruthCheck
from wiclosure.pipeline.evaluation.errors import matched, rigid_alignment
from wiclosure.pipeline.report.html.advice import doubts, next_steps
from wiclosure.pipeline.report.html.candidates_data import Overlap, candidate_matrices
from wiclosure.pipeline.report.html.closures_data import closure_rows, scans_of_closures, stages_with_reasons
from wiclosure.pipeline.report.html.radio_data import Tracks, radio_pair
from wiclosure.pipeline.report.html.scene_data import MAP_POINTS, Placement, map_entry, robot_entry
from wiclosure.pipeline.report.html.tables_data import figure_tables
from wiclosure.pipeline.report.html.verdict import headline_numbers, run_verdict
from wiclosure.pipeline.report.html.versions import versions
from wiclosure.pipeline.stages.run_result import RunResult, Solution
from wiclosure.types import FloatArray, FrameAlignment


def run_data(result: RunResult) -> dict[str, Any]:
    """Everything that the page shows of a run."""
    metrics, solution = result.metrics, result.solution
    placement = Placement.of(solution.graph.components, result.merged)
    keyframes = {robot: front.keyframes for robot, front in result.fronts.items()}
    began_ns = min(int(front.odometry.stamps_ns[0]) for front in result.fronts.values())
    alignments = alignments_with_reasons(solution)
    return {
        "name": solution.filtered.filter_name,
        "verdict": run_verdict(metrics, next_steps(result), doubts(solution)),
        "numbers": headline_numbers(metrics),
        "robots": _robots(result, placement),
        "map": map_entry(result.merged_map, len(result.fronts), placement.offset[solution.graph.components[0][0]]),
        "map_note": _map_note(result),
        "closures": closure_rows(solution.closures, solution.graph.trajectories, placement, _truth_check(result)),
        "clouds": scans_of_closures(solution.closures, {robot: f.clouds for robot, f in result.fronts.items()}),
        "funnel": stages_with_reasons(metrics["funnel"], solution.closures),
        "matrices": candidate_matrices(
            solution.filtered.pairs,
            keyframes,
            solution.closures,
            Overlap(result.inputs.ground_truth, result.config.evaluation),
        ),
        "radio": [
            radio_pair(
                alignment,
                result.inputs.wireless,
                tracks_of(result, alignment, placement),
                began_ns=began_ns,
                of_pairs=len(alignments),
            )
            for alignment in alignments
        ],
        "tables": figure_tables(metrics),
        "seconds": metrics["seconds"],
        "config": dump_config(result.config),
        "versions": versions(),
    }


def alignments_with_reasons(solution: Solution) -> list[FrameAlignment]:
    """Of all robots that measured each other, also where nothing was aligned by it; with all that is said of them."""
    said = dict.fromkeys((*solution.doubts, *solution.contradictions))
    left_out = (FrameAlignment(a, b, None, None, True, "") for a, b in solution.without_radio)
    found = []
    for one in (*solution.filtered.alignments, *left_out):
        name = f"{one.robot_a} and {one.robot_b}: "
        reasons = [one.reason, *(text.removeprefix(name) for text in said if text.startswith(name))]
        found.append(replace(one, reason="; ".join(filter(None, reasons))))
    return found


def _truth_check(result: RunResult) -> TruthCheck:
    settings = result.config.evaluation
    truth = in_lidar_axes(result.merged, result.inputs.ground_truth, settings.ground_truth_gap_s)
    keyframes = {robot: front.keyframes for robot, front in result.fronts.items()}
    return TruthCheck.of(settings, keyframes, truth.oriented)


def _robots(result: RunResult, placement: Placement) -> list[dict[str, Any]]:
    truths = _truths(result)
    return [
        robot_entry(
            number,
            len(result.fronts),
            path=result.merged[robot],
            odometry=front.odometry,
            keyframes=result.solution.graph.trajectories[robot],
            placement=placement,
            truth=truths.get(robot),
        )
        for number, (robot, front) in enumerate(result.fronts.items())
    ]


def _truths(result: RunResult) -> dict[str, FloatArray]:
    """Ground truth `(N, 3)` by robot, laid over the merged trajectories of the robot's component."""
    truth, gap_s = result.inputs.ground_truth, result.config.evaluation.ground_truth_gap_s
    placed: dict[str, FloatArray] = {}
    for component in result.solution.graph.components:
        pairs = [pair for r in component if len(pair := matched(result.merged[r], truth.get(r), gap_s))]
        if not pairs:
            continue
        estimate, true = (np.concatenate([getattr(p, side) for p in pairs])[:, :3, 3] for side in ("estimate", "truth"))
        T_world_truth = rigid_alignment(true, estimate)
        placed |= {r: se3.transform(T_world_truth, truth[r].positions) for r in component if r in truth}
    return placed


def _map_note(result: RunResult) -> str:
    unconnected, points = result.solution.graph.unconnected, len(result.merged_map)
    notes = []
    if points > MAP_POINTS:
        notes.append(f"{MAP_POINTS:,} of the map's {points:,} points are drawn; map.ply holds all.")
    if unconnected:
        notes.append(f"Not connected, drawn beside the map in a frame of its own: {', '.join(unconnected)}.")
    return " ".join(notes)


def tracks_of(result: RunResult, alignment: FrameAlignment, placement: Placement) -> Tracks:
    """Where both were: in the merged world, or, if nothing connects them, as the radio aligns them."""
    a, b = alignment.robot_a, alignment.robot_b
    if placement.together(a, b):
        return Tracks(result.merged[a], result.merged[b], placement.offset[a])
    if alignment.best is None:
        return Tracks(None, None, None)
    odometry_a, odometry_b = (result.fronts[robot].odometry for robot in (a, b))
    return Tracks(odometry_a, odometry_b.moved(alignment.best.T_a_b), None)
