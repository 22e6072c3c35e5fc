"""The pictures of a run and of a comparison: what is drawn from which result."""

from __future__ import annotations

from pathlib import Path

from wiclosure.pipeline.comparison import Comparison
from wiclosure.pipeline.pictures import draw_arms, draw_candidates, draw_trajectories
from wiclosure.pipeline.run import RunResult


def illustrate_run(folder: Path, result: RunResult) -> None:
    """Writes `trajectories.png`, and `candidates_<a>_<b>.png` for each pair of robots, into the run's folder."""
    draw_trajectories(
        folder / "trajectories.png",
        odometry={robot: front.odometry for robot, front in result.fronts.items()},
        merged=result.merged,
        keyframes=result.solution.graph.trajectories,
        closures=result.solution.closures,
        components=result.solution.graph.components,
        truth=result.inputs.ground_truth,
        gap_s=result.config.evaluation.ground_truth_gap_s,
    )
    _candidates(folder, {result.metrics["filter"]: result})


def illustrate_comparison(folder: Path, comparison: Comparison) -> None:
    """Writes the pictures of each arm, and those that show all arms side by side."""
    for name, result in comparison.arms.items():
        illustrate_run(folder / name, result)
    draw_arms(folder / "arms.png", comparison.metrics)
    _candidates(folder, comparison.arms)


def _candidates(folder: Path, arms: dict[str, RunResult]) -> None:
    first = next(iter(arms.values()))
    keyframes = {robot: front.keyframes for robot, front in first.fronts.items()}
    for number, pairs in enumerate(first.solution.filtered.pairs):
        draw_candidates(
            folder / f"candidates_{pairs.robot_a}_{pairs.robot_b}.png",
            {name: result.solution.filtered.pairs[number] for name, result in arms.items()},
            keyframes=keyframes,
            closures={name: result.solution.closures for name, result in arms.items()},
            truth=first.inputs.ground_truth,
            radius_m=first.config.evaluation.overlap_radius_m,
            gap_s=first.config.evaluation.ground_truth_gap_s,
        )
