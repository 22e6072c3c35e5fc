"""How good a run was, against ground truth where there is one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from wiclosure.pipeline.evaluation.body_axes import in_lidar_axes
from wiclosure.pipeline.evaluation.closures import TruthCheck, candidate_metrics, closure_metrics
from wiclosure.pipeline.evaluation.funnel import funnel
from wiclosure.pipeline.evaluation.metrics import CostMetrics, Metrics, TrajectoryMetrics
from wiclosure.pipeline.evaluation.radio import radio_metrics, start_metrics
from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.pipeline.evaluation.trajectories import odometry_errors, trajectory_metrics
from wiclosure.types import Closure, FilterResult, Trajectory


@dataclass(frozen=True, eq=False)
class Findings:
    """What a run found, as far as ground truth can tell.

    Args:
        filtered: what the candidate filter kept.
        closures: every proposed closure with its final decision.
        components: robots that accepted closures connect.
        keyframes: keyframe odometry by robot; candidates and closures refer to its indices.
        odometry: odometry by robot, of keyframes or of all scans.
        merged: `T_world_body` by robot, of keyframes or of all scans.
    """

    filtered: FilterResult
    closures: Sequence[Closure]
    components: Sequence[Sequence[str]]
    keyframes: Mapping[str, Trajectory]
    odometry: Mapping[str, Trajectory]
    merged: Mapping[str, Trajectory]


def evaluate(
    found: Findings,
    truth: Mapping[str, Trajectory],
    settings: EvaluationSettings,
    *,
    costs: CostMetrics,
    diagnosis: Sequence[str] = (),
) -> Metrics:
    """All of `metrics.json`.

    Args:
        found: what is held against ground truth.
        truth: ground truth by robot, all in one world; robots may be missing, and it may be empty.
        settings: what counts as true.
        costs: what the run took.
        diagnosis: sentences so far; those of the evaluation are added.
    """
    gap_s = settings.ground_truth_gap_s
    oriented = in_lidar_axes(found.merged, truth, gap_s)
    truth_check = TruthCheck.of(settings, found.keyframes, oriented.oriented)
    candidates, registrable = (
        candidate_metrics(found.filtered.pairs, found.keyframes, truth, radius_m=radius_m, gap_s=gap_s)
        for radius_m in (settings.overlap_radius_m, settings.registrable_radius_m)
    )
    trajectories = trajectory_metrics(
        found.merged,
        found.components,
        oriented,
        gap_s=gap_s,
        rpe_distance_m=settings.rpe_distance_m,
        alignments=found.filtered.alignments,
    )
    return {
        "filter": found.filtered.filter_name,
        "pairs_total": found.filtered.pairs_total,
        "pairs_kept": found.filtered.pairs_kept,
        "candidates": candidates,
        "candidates_registrable": registrable,
        "closures": closure_metrics(found.closures, truth_check),
        "funnel": funnel(candidates, found.filtered, found.closures, truth, truth_check),
        "radio": radio_metrics(found.filtered),
        "starts": start_metrics(found.merged, found.components),
        "ate_odometry_m": odometry_errors(found.odometry, oriented, gap_s=gap_s),
        **trajectories,
        **costs,
        "earth": None,
        "doubts": [],
        "diagnosis": [*diagnosis, *trajectories["diagnosis"]],
    }


def evaluate_trajectories(
    merged: Mapping[str, Trajectory],
    components: Sequence[Sequence[str]],
    truth: Mapping[str, Trajectory],
    settings: EvaluationSettings,
) -> TrajectoryMetrics:
    """The part of the metrics that needs nothing but merged trajectories and ground truth.

    Args:
        merged: `T_world_body` by robot.
        components: robots that accepted closures connect.
        truth: ground truth by robot, as far as there is any.
        settings: how ground truth is used.
    """
    gap_s = settings.ground_truth_gap_s
    oriented = in_lidar_axes(merged, truth, gap_s)
    return trajectory_metrics(merged, components, oriented, gap_s=gap_s, rpe_distance_m=settings.rpe_distance_m)
