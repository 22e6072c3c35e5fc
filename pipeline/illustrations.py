"""The pictures of a run and of a comparison: what is drawn from which result."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from wiclosure.pipeline.comparison import Comparison
from wiclosure.pipeline.pictures import draw_arms, draw_candidates, draw_trajectories
from wiclosure.pipeline.run import RunResult

MATRICES = 3  # robot pairs whose candidates are drawn; five robots have ten


def illustrate_run(folder: Path, result: RunResult) -> None:
    """Writes `trajectories.png`, and `candidates_<a>_<b>.png` for the pairs of robots with most candidates.

    Raises:
        OutputError: a picture cannot be written.
    """
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
    _draw_matrices(folder, {result.solution.filtered.filter_name: result})


def illustrate_comparison(folder: Path, comparison: Comparison) -> None:
    """Writes `comparison.png`, candidates with a panel an arm, and each arm's own pictures in its folder.

    Raises:
        OutputError: a picture cannot be written.
    """
    draw_arms(folder / "comparison.png", comparison.metrics)
    _draw_matrices(folder, comparison.arms)
    for name, result in comparison.arms.items():
        illustrate_run(folder / name, result)


def _draw_matrices(folder: Path, arms: Mapping[str, RunResult]) -> None:
    kept = {name: {(p.robot_a, p.robot_b): p for p in r.solution.filtered.pairs} for name, r in arms.items()}
    result = next(iter(arms.values()))
    robot_pairs = sorted(next(iter(kept.values())), key=lambda pair: -max(len(pairs[pair]) for pairs in kept.values()))
    for a, b in robot_pairs[:MATRICES]:
        draw_candidates(
            folder / f"candidates_{a}_{b}.png",
            {name: pairs[a, b] for name, pairs in kept.items()},
            keyframes={robot: front.keyframes for robot, front in result.fronts.items()},
            closures={name: r.solution.closures for name, r in arms.items()},
            truth=result.inputs.ground_truth,
            radius_m=result.config.evaluation.overlap_radius_m,
            gap_s=result.config.evaluation.ground_truth_gap_s,
        )
