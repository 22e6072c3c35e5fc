"""How good a run was, against ground truth where there is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from pydantic import Field

from wiclosure.pipeline.body_axes import OrientedTruth, in_lidar_axes
from wiclosure.pipeline.closure_quality import ClosureJudge, candidate_metrics, closure_metrics
from wiclosure.pipeline.funnel import funnel
from wiclosure.pipeline.metrics import AlignmentMetrics, ComponentMetrics, Metrics, TrajectoryMetrics
from wiclosure.pipeline.trajectory_error import (
    Matched,
    inter_robot_error,
    joint_errors,
    matched,
    relative_errors,
    rms,
)
from wiclosure.settings import Settings
from wiclosure.types import Closure, FilterResult, FloatArray, Trajectory, robot_pairs


class EvaluationSettings(Settings):
    """What counts as true."""

    overlap_radius_m: float = Field(
        35.0, gt=0, description="m; keyframes nearer than this see a common place (the paper's radius): `candidates`"
    )
    registrable_radius_m: float = Field(
        10.0, gt=0, description="m; keyframes nearer than this can be registered reliably: `candidates_registrable`"
    )
    closure_error_m: float = Field(
        2.0,
        gt=0,
        description="m; an accepted closure further off ground truth is false. Ground truth itself is good to a metre"
        " or so (GNSS, or two passes through one place), false closures are off by tens",
    )
    closure_error_deg: float = Field(
        5.0, gt=0, description="degrees; an accepted closure turned further from ground truth is false"
    )
    ground_truth_gap_s: float = Field(
        1.0, gt=0, description="s; a pose is compared only if ground truth has stamps this near on both sides"
    )
    rpe_distance_m: float = Field(10.0, gt=0, description="m; path length over which relative pose errors are taken")

    def judge(self, keyframes: Mapping[str, Trajectory], oriented: OrientedTruth) -> ClosureJudge:
        """Tells which closures between these keyframes are true."""
        return ClosureJudge(
            keyframes, oriented.oriented, self.closure_error_m, self.closure_error_deg, self.ground_truth_gap_s
        )


def evaluate(
    *,
    filtered: FilterResult,
    keyframes: Mapping[str, Trajectory],
    verified: Sequence[Closure],
    consistent: Sequence[Closure],
    closures: Sequence[Closure],
    odometry: Mapping[str, Trajectory],
    merged: Mapping[str, Trajectory],
    components: Sequence[Sequence[str]],
    truth: Mapping[str, Trajectory],
    settings: EvaluationSettings,
    seconds: Mapping[str, float],
    seconds_spent: Mapping[str, float],
    bytes_exchanged: int | None = None,
    peak_rss_mb: float | None = None,
    diagnosis: Sequence[str] = (),
) -> Metrics:
    """All of `metrics.json`.

    Args:
        filtered: what the candidate filter kept.
        keyframes: keyframe odometry by robot; candidates and closures refer to its indices.
        verified: every proposed closure as registration left it.
        consistent: the same closures as PCM left them.
        closures: the same closures as the graph left them.
        odometry: odometry by robot, of keyframes or of all scans.
        merged: `T_world_body` by robot, of keyframes or of all scans.
        components: robots that accepted closures connect.
        truth: ground truth by robot, all in one world; robots may be missing, and it may be empty.
        settings: what counts as true.
        seconds: wall time a stage, from raw scans.
        seconds_spent: the same without what was taken from earlier work.
        bytes_exchanged: what the robots would have sent each other.
        peak_rss_mb: peak memory.
        diagnosis: sentences so far; those of the evaluation are added.
    """
    gap_s = settings.ground_truth_gap_s
    ambiguous = {frozenset((a.robot_a, a.robot_b)): a.ambiguous for a in filtered.alignments}
    oriented = in_lidar_axes(merged, truth, gap_s)
    trajectories = _evaluate_trajectories(merged, components, oriented, settings, ambiguous)
    judge = settings.judge(keyframes, oriented)
    candidates = candidate_metrics(filtered.pairs, keyframes, truth, radius_m=settings.overlap_radius_m, gap_s=gap_s)
    return {
        "filter": filtered.filter_name,
        "pairs_total": filtered.pairs_total,
        "pairs_kept": filtered.pairs_kept,
        "candidates": candidates,
        "candidates_registrable": candidate_metrics(
            filtered.pairs, keyframes, truth, radius_m=settings.registrable_radius_m, gap_s=gap_s
        ),
        "closures": closure_metrics(verified, closures, judge),
        "funnel": funnel(
            candidates,
            pairs_total=filtered.pairs_total,
            pairs_kept=filtered.pairs_kept,
            verified=verified,
            consistent=consistent,
            final=closures,
            truth=truth,
            judge=judge,
        ),
        "ate_odometry_m": _odometry_errors(odometry, oriented, gap_s),
        **trajectories,
        "seconds": dict(seconds),
        "seconds_spent": dict(seconds_spent),
        "bytes_exchanged": bytes_exchanged,
        "peak_rss_mb": peak_rss_mb,
        "diagnosis": [*diagnosis, *trajectories["diagnosis"]],
    }


def evaluate_trajectories(
    merged: Mapping[str, Trajectory],
    components: Sequence[Sequence[str]],
    truth: Mapping[str, Trajectory],
    settings: EvaluationSettings,
    ambiguous: Mapping[frozenset[str], bool] | None = None,
) -> TrajectoryMetrics:
    """The part of the metrics that needs nothing but merged trajectories and ground truth.

    Args:
        merged: `T_world_body` by robot.
        components: robots that accepted closures connect.
        truth: ground truth by robot, as far as there is any.
        settings: how ground truth is used.
        ambiguous: for pairs of robots, whether the radio's alignment was ambiguous.
    """
    oriented = in_lidar_axes(merged, truth, settings.ground_truth_gap_s)
    return _evaluate_trajectories(merged, components, oriented, settings, ambiguous or {})


def _evaluate_trajectories(
    merged: Mapping[str, Trajectory],
    components: Sequence[Sequence[str]],
    oriented: OrientedTruth,
    settings: EvaluationSettings,
    ambiguous: Mapping[frozenset[str], bool],
) -> TrajectoryMetrics:
    robots = _all_matched(merged, oriented, settings.ground_truth_gap_s)
    by_component = [joint_errors([robots[robot] for robot in group]) for group in components]
    errors = {robot: error for group in by_component for robot, error in group.items()}
    parts: list[ComponentMetrics] = [
        {"robots": list(group), "ate_m": _rms_of_all(found)}
        for group, found in zip(components, by_component, strict=True)
    ]
    judged = [part for part in parts if part["ate_m"] is not None]
    return {
        "ate_m": {"team": judged[0]["ate_m"] if len(judged) == 1 else None}
        | {robot: rms(errors[robot]) if robot in errors else None for robot in robots},
        "ate_own_m": {name: _rms_of_all(joint_errors([robot])) for name, robot in robots.items()},
        "components": parts,
        "rpe": {name: relative_errors(robot, settings.rpe_distance_m) for name, robot in robots.items() if len(robot)},
        "alignment": _alignments(robots, components, ambiguous),
        "diagnosis": [*oriented.remarks, *_remarks(robots, judged, oriented.truth)],
    }


def _odometry_errors(
    odometry: Mapping[str, Trajectory], oriented: OrientedTruth, gap_s: float
) -> dict[str, float | None]:
    """Error of each robot's odometry aligned on its own, and of all robots so aligned as `team`."""
    own = {
        name: joint_errors([robot]).get(name, np.zeros(0))
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


def _alignments(
    robots: Mapping[str, Matched], components: Sequence[Sequence[str]], ambiguous: Mapping[frozenset[str], bool]
) -> dict[str, AlignmentMetrics]:
    """Errors between each two robots, by `a-b`; None for two that no closures connect."""
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
    robots: Mapping[str, Matched], judged: Sequence[ComponentMetrics], truth: Mapping[str, Trajectory]
) -> list[str]:
    """What the numbers leave out, in sentences."""
    remarks = []
    if missing := [name for name, robot in robots.items() if not len(robot)]:
        lacking = [name for name in missing if name not in truth]
        if lacking:
            remarks.append(f"no ground truth for {', '.join(lacking)}: no errors are given there")
        if elsewhere := [name for name in missing if name in truth]:
            remarks.append(f"ground truth of {', '.join(elsewhere)} does not overlap with the recording in time")
    if len(judged) > 1:
        groups = "; ".join(f"{' and '.join(part['robots'])} {part['ate_m']:.2f} m" for part in judged)
        remarks.append(
            f"no team ATE, because the robots are not all connected; each group aligned on its own: {groups}"
        )
    return remarks
