"""The pictures of a run and of a comparison: what is drawn from which result."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from wiclosure.pipeline.evaluation.body_axes import in_lidar_axes
from wiclosure.pipeline.evaluation.closures import TruthCheck
from wiclosure.pipeline.evaluation.errors import matched, rigid_alignment
from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.pipeline.report.map_picture import draw_map
from wiclosure.pipeline.report.pictures import draw_candidates
from wiclosure.pipeline.report.trajectory_pictures import MergedView, draw_merged, draw_run
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import CandidatePairs, Closure, FloatArray, Trajectory

MATRICES = 3  # robot pairs whose candidates are drawn; five robots have ten


@dataclass(frozen=True, eq=False)
class Sketch:
    """What pictures of a comparison need of an arm: no clouds.

    Args:
        view: merged trajectories.
        pairs: kept candidates.
        closures: with their final decisions.
        keyframes: odometry by robot.
        truth: ground truth by robot.
        settings: what counts as true.
    """

    view: MergedView
    pairs: tuple[CandidatePairs, ...]
    closures: tuple[Closure, ...]
    keyframes: Mapping[str, Trajectory]
    truth: Mapping[str, Trajectory]
    settings: EvaluationSettings

    @classmethod
    def of(cls, result: RunResult) -> Self:
        """Of a finished run."""
        return cls(
            view=merged_view(result),
            pairs=result.solution.filtered.pairs,
            closures=result.solution.closures,
            keyframes={robot: front.keyframes for robot, front in result.fronts.items()},
            truth=result.inputs.ground_truth,
            settings=result.config.evaluation,
        )


def merged_view(result: RunResult) -> MergedView:
    """The first component's trajectories, laid over ground truth."""
    graph, truth = result.solution.graph, result.inputs.ground_truth
    gap_s = result.config.evaluation.ground_truth_gap_s
    connected = [robot for robot in result.merged if robot in graph.components[0]]
    pairs = [matched(result.merged[robot], truth.get(robot), gap_s) for robot in connected]
    pairs = [pair for pair in pairs if len(pair)]
    T_shown_world = np.eye(4)
    if pairs:
        estimate, true = (
            np.concatenate([poses[:, :3, 3] for poses in side])
            for side in ([p.estimate for p in pairs], [p.truth for p in pairs])
        )
        T_shown_world = rigid_alignment(estimate, true)
    accepted = [c for c in graph.accepted if c.query.robot in connected]
    keyframes = {robot: front.keyframes for robot, front in result.fronts.items()}
    oriented = in_lidar_axes(result.merged, truth, gap_s).oriented
    truth_check = TruthCheck.of(result.config.evaluation, keyframes, oriented)
    right, known = truth_check.right(accepted)
    ends = [[graph.trajectories[k.robot].positions[k.index] for k in (c.query, c.match)] for c in accepted]
    return MergedView(
        odometry={robot: front.odometry.positions[:, :2] for robot, front in result.fronts.items()},
        paths={robot: _from_above(T_shown_world, result.merged[robot].positions) for robot in connected},
        truth={pair.robot: pair.truth[:, :2, 3] for pair in pairs},
        closures=_from_above(T_shown_world, np.array(ends).reshape(-1, 3)).reshape(-1, 2, 2),
        false=known & ~right,
        ate_m=result.metrics["ate_m"]["team"],
    )


def illustrate_run(folder: Path, result: RunResult) -> None:
    """Writes `trajectories.png`, `map.png`, and `candidates_<a>_<b>.png` for the pairs of robots with most candidates.

    Raises:
        OutputError: a picture cannot be written.
    """
    sketch = Sketch.of(result)
    draw_run(folder / "trajectories.png", sketch.view)
    nowhere = np.zeros((0, 3))
    connected = result.solution.graph.components[0]
    paths = {robot: path.positions if robot in connected else nowhere for robot, path in result.merged.items()}
    draw_map(folder / "map.png", result.merged_map, paths)
    _draw_matrices(folder, {result.solution.filtered.filter_name: sketch})


def illustrate_arms(folder: Path, arms: Mapping[str, Sketch]) -> None:
    """Arms over the same recordings side by side: `trajectories.png` and `candidates_<a>_<b>.png`.

    Raises:
        OutputError: a picture cannot be written.
    """
    draw_merged(folder / "trajectories.png", {name: sketch.view for name, sketch in arms.items()})
    _draw_matrices(folder, arms)


def _draw_matrices(folder: Path, arms: Mapping[str, Sketch]) -> None:
    kept = {name: {(p.robot_a, p.robot_b): p for p in sketch.pairs} for name, sketch in arms.items()}
    sketch = next(iter(arms.values()))
    robot_pairs = sorted(next(iter(kept.values())), key=lambda pair: -max(len(pairs[pair]) for pairs in kept.values()))
    for a, b in robot_pairs[:MATRICES]:
        draw_candidates(
            folder / f"candidates_{a}_{b}.png",
            {name: pairs[a, b] for name, pairs in kept.items()},
            keyframes=sketch.keyframes,
            closures={name: arm.closures for name, arm in arms.items()},
            truth=sketch.truth,
            radius_m=sketch.settings.overlap_radius_m,
            gap_s=sketch.settings.ground_truth_gap_s,
        )


def _from_above(T_shown_world: FloatArray, positions: FloatArray) -> FloatArray:
    return np.asarray(positions @ T_shown_world[:2, :3].T + T_shown_world[:2, 3])
