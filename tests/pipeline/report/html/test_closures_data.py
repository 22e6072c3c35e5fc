from __future__ import annotations

import numpy as np

from wiclosure.pipeline.evaluation.body_axes import in_lidar_axes
from wiclosure.pipeline.evaluation.closures import TruthCheck
from wiclosure.pipeline.report.html.closures_data import (
    CLOUD_POINTS,
    closure_rows,
    reason_kind,
    scans_of_closures,
    stages_with_reasons,
)
from wiclosure.pipeline.report.html.packing import unpacked_array
from wiclosure.pipeline.report.html.scene_data import Placement
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import Closure, KeyframeId, Stage, Trajectory


def rejected(n: int, stage: Stage, reason: str) -> Closure:
    return Closure(KeyframeId("a", n), KeyframeId("b", n)).rejected(stage, reason)


def test_like_reasons_are_counted_together_the_most_frequent_first() -> None:
    closures = [
        rejected(0, Stage.REGISTRATION, "only 0.31 of the structure matches, 0.40 needed"),
        rejected(1, Stage.REGISTRATION, "ambiguous: another pose fits"),
        rejected(2, Stage.REGISTRATION, "only 0.22 of the structure matches, 0.40 needed"),
    ]
    funnel = [{"stage": stage, "count": 3, "true": None, "false": None} for stage in ("kept", "registered")]
    kept, registered = stages_with_reasons(funnel, closures)
    assert kept["reasons"] == []
    assert [(r["text"], r["count"], r["rows"]) for r in registered["reasons"]] == [
        ("only … of the structure matches, … needed", 2, [0, 2]),
        ("ambiguous: another pose fits", 1, [1]),
    ]
    assert reason_kind("10^-12 to 1, 3.5 m") == "… to …, … m"


def test_every_rejected_closure_has_its_reason_at_its_stage(lost_run: RunResult) -> None:
    closures = lost_run.solution.closures
    stages = stages_with_reasons(lost_run.metrics["funnel"], closures)
    rows = [row for stage in stages for reason in stage["reasons"] for row in reason["rows"]]
    assert sorted(rows) == [n for n, c in enumerate(closures) if c.rejected_at is not None]


def test_true_and_false_where_there_is_a_measured_pose(lost_run: RunResult) -> None:
    truth = lost_run.config.evaluation
    keyframes = {robot: front.keyframes for robot, front in lost_run.fronts.items()}
    oriented = in_lidar_axes(lost_run.merged, lost_run.inputs.ground_truth, 1.0).oriented
    truth_check = TruthCheck.of(truth, keyframes, oriented)
    placement = Placement.of(lost_run.solution.graph.components, lost_run.merged)
    rows = closure_rows(lost_run.solution.closures, lost_run.solution.graph.trajectories, placement, truth_check)
    for row, closure in zip(rows, lost_run.solution.closures, strict=True):
        expected = None if closure.measured is None else closure.rejected_at is None
        assert row["true"] is expected
        assert row["decision"] == ("accepted" if closure.rejected_at is None else "rejected")
    assert {row["true"] for row in rows} == {True, False, None}


def test_closures_are_drawn_where_their_robots_are() -> None:
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[1, 0, 3] = 4.0
    robots = {name: Trajectory(name, np.array([1, 2]) * 10**9, poses) for name in ("a", "b")}
    placement = Placement.of((("a", "b"),), robots)
    (row,) = closure_rows([rejected(1, Stage.MATCHING, "")], robots, placement)
    assert row["ends"] == [2.0, 0.0, 0.0, 2.0, 0.0, 0.0]  # the middle of both paths is the origin


def test_scans_of_accepted_and_rejected_closures(lost_run: RunResult) -> None:
    clouds = {robot: front.clouds for robot, front in lost_run.fronts.items()}
    found = scans_of_closures(lost_run.solution.closures, clouds)
    names = {f"{k.robot}:{k.index}" for c in lost_run.solution.closures for k in (c.query, c.match)}
    assert set(found) == names
    cloud = unpacked_array(next(iter(found.values())))
    original = clouds["alpha"][int(next(iter(found)).split(":")[1])]
    assert len(cloud) == len(original)
    np.testing.assert_allclose(np.sort(cloud, axis=0), np.sort(original, axis=0), atol=0.026)


def test_large_scans_are_thinned_and_what_is_no_number_left_out() -> None:
    cloud = np.random.default_rng(0).uniform(-5, 5, (10_000, 3)).astype(np.float32)
    cloud[::100] = np.nan
    found = scans_of_closures([rejected(0, Stage.MATCHING, "")], {"a": [cloud], "b": [cloud[:0]]})
    points = unpacked_array(found["a:0"])
    assert CLOUD_POINTS / 2 < len(points) <= CLOUD_POINTS
    assert np.isfinite(points).all()
    assert unpacked_array(found["b:0"]).shape == (0, 3)
