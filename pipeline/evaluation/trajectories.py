"""Merged trajectories, and plain odometry, against ground truth."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from wiclosure.pipeline.evaluation.body_axes import OrientedTruth
from wiclosure.pipeline.evaluation.errors import (
    Matched,
    inter_robot_error,
    joint_errors,
    matched,
    relative_errors,
    rms,
)
from wiclosure.pipeline.evaluation.metrics import AlignmentMetrics, ComponentMetrics, TrajectoryMetrics
from wiclosure.types import FloatArray, FrameAlignment, Trajectory, robot_pairs


def trajectory_metrics(
    merged: Mapping[str, Trajectory],
    components: Sequence[Sequence[str]],
    oriented: OrientedTruth,
    *,
    gap_s: float,
    rpe_distance_m: float,
    alignments: Sequence[FrameAlignment] = (),
) -> TrajectoryMetrics:
    """Errors of robots, of teams, and between robots.

    Args:
        merged: `T_world_body` by robot.
        components: robots that accepted closures connect.
        oriented: ground truth by robot, as far as there is any.
        gap_s: how near ground truth must be in time.
        rpe_distance_m: path length over which relative pose errors are taken.
        alignments: what the radio said of the robots' frames.
    """
    robots = _all_matched(merged, oriented, gap_s)
    by_component = [joint_errors([robots[robot] for robot in group]) for group in components]
    errors = {robot: error for group in by_component for robot, error in group.items()}
    parts: list[ComponentMetrics] = [
        {"robots": list(group), "ate_m": _rms_of_all(found)}
        for group, found in zip(components, by_component, strict=True)
    ]
    evaluated = [part for part in parts if part["ate_m"] is not None]
    return {
        "ate_m": _by_team_and_robot(robots, errors, connected=len(evaluated) == 1),
        "ate_horizontal_m": _by_team_and_robot(
            robots, {robot: error[:, :2] for robot, error in errors.items()}, connected=len(evaluated) == 1
        ),
        "ate_own_m": {name: _rms_of_all(joint_errors([robot])) for name, robot in robots.items()},
        "components": parts,
        "rpe": {name: relative_errors(robot, rpe_distance_m) for name, robot in robots.items() if len(robot)},
        "alignment": _between_robots(robots, components, alignments),
        "diagnosis": [*oriented.remarks, *_remarks(robots, evaluated, oriented.truth)],
    }


def odometry_errors(
    odometry: Mapping[str, Trajectory], oriented: OrientedTruth, *, gap_s: float
) -> dict[str, float | None]:
    """RMS error (m) of each robot's odometry aligned on its own, and of all robots so aligned as `team`."""
    own = {
        name: joint_errors([robot]).get(name, np.zeros((0, 3)))
        for name, robot in _all_matched(odometry, oriented, gap_s).items()
    }
    return {"team": rms(np.concatenate(list(own.values())))} | {name: rms(errors) for name, errors in own.items()}


def _all_matched(trajectories: Mapping[str, Trajectory], oriented: OrientedTruth, gap_s: float) -> dict[str, Matched]:
    """`matched` for each robot; empty where there is no ground truth."""
    return {
        robot: replace(matched(trajectory, oriented.truth.get(robot), gap_s), oriented=robot not in oriented.unoriented)
        for robot, trajectory in trajectories.items()
    }


def _rms_of_all(errors: Mapping[str, FloatArray]) -> float | None:
    return rms(np.concatenate(list(errors.values()))) if errors else None


def _by_team_and_robot(
    robots: Iterable[str], errors: Mapping[str, FloatArray], *, connected: bool
) -> dict[str, float | None]:
    team = {"team": _rms_of_all(errors) if connected else None}
    return team | {robot: rms(errors[robot]) if robot in errors else None for robot in robots}


def _between_robots(
    robots: Mapping[str, Matched], components: Sequence[Sequence[str]], alignments: Sequence[FrameAlignment]
) -> dict[str, AlignmentMetrics]:
    """Errors between each two robots, by `a-b`; None for two that no closures connect."""
    ambiguous = {frozenset((a.robot_a, a.robot_b)): a.ambiguous for a in alignments}
    found: dict[str, AlignmentMetrics] = {}
    for a, b in robot_pairs(list(robots)):
        connected = any(a in group and b in group for group in components)
        error = inter_robot_error(robots[a], robots[b]) if connected else None
        found[f"{a}-{b}"] = {
            "translation_error_m": error[0] if error else None,
            "rotation_error_deg": error[1] if error else None,
            "ambiguous": ambiguous.get(frozenset((a, b))),
        }
    return found


def _remarks(
    robots: Mapping[str, Matched], evaluated: Sequence[ComponentMetrics], truth: Mapping[str, Trajectory]
) -> list[str]:
    """What the numbers leave out, in sentences."""
    remarks = []
    if missing := [name for name, robot in robots.items() if not len(robot)]:
        lacking = [name for name in missing if name not in truth]
        if lacking:
            remarks.append(f"no ground truth for {', '.join(lacking)}: no errors are given there")
        if elsewhere := [name for name in missing if name in truth]:
            remarks.append(f"ground truth of {', '.join(elsewhere)} does not overlap with the recording in time")
    if len(evaluated) > 1:
        groups = "; ".join(f"{' and '.join(part['robots'])} {part['ate_m']:.2f} m" for part in evaluated)
        remarks.append(
            f"no team ATE, because the robots are not all connected; each group aligned on its own: {groups}"
        )
    return remarks
