"""The files of a run: what `wiclosure run` leaves behind, and what `wiclosure eval` reads again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pydantic import ValidationError

from wiclosure import se3
from wiclosure.backends.graph_files.g2o_writer import write_g2o
from wiclosure.backends.merged.map_writers import write_pcd, write_ply
from wiclosure.backends.merged.occupancy import occupancy, write_occupancy
from wiclosure.errors import InputError
from wiclosure.formats.candidates_csv import write_candidates
from wiclosure.formats.structured_text import read_json, read_yaml
from wiclosure.formats.trajectories.kitti_poses import write_kitti_poses
from wiclosure.formats.trajectories.tum import read_tum, write_tum
from wiclosure.pipeline.config import dump_config
from wiclosure.pipeline.evaluation.errors import truth_at
from wiclosure.pipeline.evaluation.metrics import Metrics
from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.pipeline.runtime.output import write_json
from wiclosure.pipeline.runtime.settings_text import explain
from wiclosure.pipeline.stages.closures_csv import write_closures
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import Trajectory


def write_run(folder: Path, result: RunResult) -> None:
    """Writes everything but the pictures into an existing folder.

    All stamps are the scans' own, as the recording states them: trajectories, ground truth beside them, candidates and
    closures join by them.
    """
    (folder / "config.yaml").write_text(dump_config(result.config), encoding="utf-8")
    write_json(folder / "metrics.json", result.metrics)
    for robot, front in result.fronts.items():
        write_tum(folder / f"{robot}.tum", result.merged[robot])
        write_kitti_poses(folder / f"{robot}_kitti.txt", result.merged[robot].poses)
        write_tum(folder / f"{robot}_odometry.tum", _in_its_frame(front.scans, result))
    for robot, truth in result.inputs.ground_truth.items():
        _write_truth(folder / f"{robot}_ground_truth.tum", truth, result.merged[robot], result.config.evaluation)
    clouds = {robot: front.keyframes for robot, front in result.fronts.items()}
    stamped = {robot: front.scans.keyframes(front.keyframe_indices) for robot, front in result.fronts.items()}
    write_candidates(folder / "candidates.csv", result.solution.filtered.pairs, stamped)
    write_closures(folder / "closures.csv", result.solution.closures, stamped, clouds)
    write_g2o(result.solution.graph, folder / "graph.g2o")
    write_ply(result.merged_map, folder / "map.ply")
    write_pcd(result.merged_map, folder / "map.pcd")
    write_occupancy(occupancy(result.merged_map, result.config.map), folder)


def _in_its_frame(odometry: Trajectory, result: RunResult) -> Trajectory:
    """Odometry in the frame that the robot brought along: not set upright, and from its own origin."""
    origin_m = next(robot.odometry_origin_m for robot in result.inputs.robots if robot.robot == odometry.robot)
    T_odom_local = np.eye(4)
    T_odom_local[:3, 3] = origin_m
    T_level_odom = result.grounding.T_level_odom.get(odometry.robot)
    if T_level_odom is not None:
        T_odom_local = T_odom_local @ se3.inverse(T_level_odom)
    return odometry if (T_odom_local == np.eye(4)).all() else odometry.moved(T_odom_local)


def _write_truth(path: Path, truth: Trajectory, merged: Trajectory, settings: EvaluationSettings) -> None:
    """Ground truth at the stamps of the merged trajectory, as far as it reaches."""
    poses, covered = truth_at(truth, merged.stamps_ns, settings.ground_truth_gap_s)
    if covered.any():
        write_tum(path, Trajectory(truth.robot, merged.stamps_ns[covered], poses[covered]))


def read_metrics(folder: Path) -> Metrics:
    """The figures of a finished run.

    Raises:
        InputError: the folder is not one that `wiclosure run` wrote.
    """
    path = folder / "metrics.json"
    if not path.exists() and (folder / "comparison.json").exists():
        arms = [str(arm.parent) for arm in sorted(folder.rglob("metrics.json"))]
        some = ", ".join(arms[:4]) + (" ..." if len(arms) > 4 else "")
        raise InputError(f"{folder} is a comparison; give the folder of one of its arms: {some}")
    try:
        content = read_json(path)
    except InputError as error:
        raise InputError(f"{error}; give a folder that wiclosure run wrote") from error
    if not _names_robots(content):
        raise InputError(f"{path} does not hold the metrics of a run; give a folder that wiclosure run wrote")
    metrics: Metrics = content
    return metrics


def _names_robots(metrics: object) -> bool:
    """Whether there are components, each with the names of its robots."""
    components = metrics.get("components") if isinstance(metrics, dict) else None
    return isinstance(components, list) and all(
        isinstance(component, dict)
        and isinstance(component.get("robots"), list)
        and all(isinstance(robot, str) for robot in component["robots"])
        for component in components
    )


def read_evaluation_settings(folder: Path) -> EvaluationSettings:
    """How the run was evaluated; the rest of its configuration may be of another version.

    Raises:
        InputError: the configuration is missing or damaged.
    """
    path = folder / "config.yaml"
    try:
        return EvaluationSettings.model_validate(read_yaml(path).get("evaluation", {}))
    except ValidationError as error:
        raise InputError(explain(error, str(path), EvaluationSettings)) from error
    except (AttributeError, ValueError) as error:
        raise InputError(f"{path} does not hold the configuration of a run: {error}") from error


def read_trajectories(folder: Path) -> tuple[dict[str, Trajectory], dict[str, Trajectory]]:
    """Merged trajectories of a finished run, and ground truth, by robot.

    Raises:
        InputError: a trajectory is missing or damaged.
    """
    metrics = read_metrics(folder)
    robots = [robot for component in metrics["components"] for robot in component["robots"]]
    if outside := [robot for robot in robots if robot != Path(robot).name]:
        raise InputError(f"{folder}/metrics.json names a robot {outside[0]!r}, which is no name of a file")
    merged = {robot: read_tum(folder / f"{robot}.tum", robot) for robot in robots}
    paths = {robot: folder / f"{robot}_ground_truth.tum" for robot in robots}
    return merged, {robot: read_tum(path, robot) for robot, path in paths.items() if path.exists()}
