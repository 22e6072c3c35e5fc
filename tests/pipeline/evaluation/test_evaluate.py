from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.evaluation.evaluate import Findings, evaluate
from wiclosure.pipeline.evaluation.funnel import STAGES
from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.types import (
    CandidatePairs,
    Closure,
    FilterResult,
    FrameAlignment,
    KeyframeId,
    Stage,
    Trajectory,
)

from .known_paths import SECOND, path, turned

TRUTH = {"alpha": path(1), "beta": path(2, robot="beta"), "gamma": path(3, robot="gamma")}
COSTS = {"seconds": {"total": 1.0}, "seconds_spent": {"total": 0.5}, "bytes_exchanged": 5, "peak_rss_mb": 100.0}


class TestWholeEvaluation:
    """`metrics.json` of small runs with known answers."""

    def closure(self, a, b, error=0.0, rejected_at=None):
        T = se3.between(TRUTH["alpha"].poses[a], TRUTH["beta"].poses[b])
        T = T @ se3.from_yaw(0.0, np.array([error, 0.0, 0.0]))
        closure = Closure.from_measurement(KeyframeId("alpha", a), KeyframeId("beta", b), T, np.eye(6))
        return closure.accepted(Stage.ESTIMATE) if rejected_at is None else closure.rejected(rejected_at, "wrong")

    def run(self, truth=TRUTH, **changes):
        odometry = {r: t.moved(se3.inverse(t.poses[0])) for r, t in TRUTH.items()}
        frame = turned(5)
        final = [
            self.closure(3, 4),
            self.closure(5, 6),
            self.closure(9, 9, 20.0),
            self.closure(7, 8, 0, Stage.CONSISTENCY),
        ]
        every = np.arange(80)
        pairs = tuple(
            CandidatePairs.without_prediction(a, b, every, every)
            for a, b in (("alpha", "beta"), ("alpha", "gamma"), ("beta", "gamma"))
        )
        filtered = FilterResult(
            "wiclosure", pairs, 3 * 6400, (FrameAlignment("alpha", "beta", None, None, True, "two walls"),)
        )
        found = Findings(
            filtered=filtered,
            closures=final,
            components=(("alpha", "beta", "gamma"),),
            keyframes=odometry,
            odometry=odometry,
            merged={r: t.moved(frame) for r, t in TRUTH.items()},
        )
        return evaluate(replace(found, **changes), truth, EvaluationSettings(), costs=COSTS, diagnosis=("all is well",))

    def test_a_perfect_merge(self):
        metrics = self.run()
        assert metrics["ate_m"] == {r: pytest.approx(0.0, abs=1e-9) for r in ("team", "alpha", "beta", "gamma")}
        assert metrics["alignment"]["alpha-beta"]["ambiguous"] is True
        assert metrics["alignment"]["alpha-gamma"]["ambiguous"] is None
        assert metrics["alignment"]["beta-gamma"]["translation_error_m"] == pytest.approx(0.0, abs=1e-9)
        assert metrics["closures"] == {
            "proposed": 4,
            "verified": 4,
            "accepted": 3,
            "verified_true": 3,
            "verified_false": 1,
            "accepted_true": 2,
            "accepted_false": 1,
        }
        assert metrics["pairs_kept"] == 240
        assert metrics["candidates"]["radius_m"] == 35.0
        assert metrics["candidates_registrable"]["radius_m"] == 10.0
        assert metrics["diagnosis"] == ["all is well"]

    def test_keys_of_the_contract_and_plain_json(self):
        metrics = self.run()
        assert json.loads(json.dumps(metrics, allow_nan=False)) == metrics
        assert {
            "filter", "pairs_total", "pairs_kept", "candidates", "candidates_registrable", "closures", "ate_m",
            "alignment", "seconds", "bytes_exchanged", "peak_rss_mb", "diagnosis",
        } <= set(metrics)  # fmt: skip
        assert {"radius_m", "true", "kept_true", "precision", "recall", "pruned"} <= set(metrics["candidates"])

    def test_heights_count_in_one_error_and_not_in_the_other(self):
        merged = {}
        for robot, trajectory in TRUTH.items():
            poses = trajectory.poses.copy()
            poses[:, 2, 3] += 0.5 * (-1.0) ** np.arange(len(poses))
            merged[robot] = Trajectory(robot, trajectory.stamps_ns, poses)
        metrics = self.run(truth={r: t.moved(turned(4)) for r, t in TRUTH.items()}, merged=merged)
        assert metrics["ate_m"] == {r: pytest.approx(0.5, rel=0.02) for r in ("team", *TRUTH)}
        assert all(error < 0.05 for error in metrics["ate_horizontal_m"].values())
        assert self.run(truth={})["ate_horizontal_m"] == dict.fromkeys(("team", *TRUTH))

    def test_the_funnel_counts_what_is_left_of_true_and_false(self):
        metrics = self.run()
        assert [stage["stage"] for stage in metrics["funnel"]] == list(STAGES)
        counts = {stage["stage"]: (stage["count"], stage["true"], stage["false"]) for stage in metrics["funnel"]}
        found = metrics["candidates"]
        assert counts["pairs"] == (19200, found["true"], 19200 - found["true"])
        assert counts["kept"] == (240, found["kept_true"], found["kept_false"])
        assert counts["registered"] == counts["radio check"] == (4, 3, 1)
        assert counts["PCM"] == (3, 2, 1)
        assert counts["graph"] == (3, 2, 1)

    @pytest.mark.parametrize(
        ("rejected_at", "left"),
        [
            (Stage.REGISTRATION, [2, 1, 1, 1, 1]),
            (Stage.RADIO_CHECK, [2, 2, 1, 1, 1]),
            (Stage.CONSISTENCY, [2, 2, 2, 1, 1]),
            (Stage.ESTIMATE, [2, 2, 2, 2, 1]),
        ],
    )
    def test_a_closure_is_lost_where_it_was_rejected(self, rejected_at, left):
        metrics = self.run(closures=[self.closure(3, 4), self.closure(9, 9, 20.0, rejected_at)])
        stages = metrics["funnel"][2:]
        assert [stage["count"] for stage in stages] == left
        assert [stage["true"] for stage in stages[1:]] == [1, 1, 1, 1]
        assert [stage["false"] for stage in stages[1:]] == [count - 1 for count in left[1:]]
        # What files call verified has been let through by registration and by the radio check.
        assert metrics["closures"]["verified"] == left[2]
        assert (metrics["closures"]["proposed"], metrics["closures"]["accepted"]) == (2, 1)

    def test_closures_that_were_never_measured_count_as_proposed_only(self):
        bare = Closure(KeyframeId("alpha", 3), KeyframeId("beta", 4)).rejected(Stage.REGISTRATION, "too few points")
        metrics = self.run(closures=[bare])
        assert [stage["count"] for stage in metrics["funnel"][2:]] == [1, 0, 0, 0, 0]
        assert metrics["closures"]["verified_false"] == 0

    def test_odometry_without_drift_has_no_error_of_its_own(self):
        assert self.run()["ate_odometry_m"]["team"] == pytest.approx(0.0, abs=1e-9)
        assert self.run(truth={})["ate_odometry_m"] == dict.fromkeys(("team", *TRUTH))

    def test_robots_that_are_not_connected_have_no_team_error(self):
        metrics = self.run(components=(("alpha", "beta"), ("gamma",)))
        assert metrics["ate_m"]["team"] is None
        assert metrics["ate_m"]["gamma"] == pytest.approx(0.0, abs=1e-9)
        assert metrics["alignment"]["alpha-gamma"]["translation_error_m"] is None
        assert [part["robots"] for part in metrics["components"]] == [["alpha", "beta"], ["gamma"]]
        assert "not all connected" in metrics["diagnosis"][-1]

    def test_without_ground_truth_errors_are_none_and_counts_stay(self):
        metrics = self.run(truth={})
        assert set(metrics["ate_m"].values()) == {None}
        assert metrics["candidates"] | {"radius_m": 0} == {
            "radius_m": 0, "true": None, "kept_true": None, "precision": None, "recall": None,
            "false": None, "kept_false": None, "false_rejected": None, "pruned": pytest.approx(1 - 240 / 19200),
        }  # fmt: skip
        assert metrics["closures"]["accepted"] == 3
        assert metrics["closures"]["accepted_false"] is None
        assert "no ground truth for alpha, beta, gamma" in metrics["diagnosis"][-1]

    def test_ground_truth_of_another_day_is_said_so(self):
        late = {r: Trajectory(r, t.stamps_ns + 86_400 * SECOND, t.poses) for r, t in TRUTH.items()}
        metrics = self.run(truth=late)
        assert metrics["ate_m"]["team"] is None
        assert "does not overlap" in metrics["diagnosis"][-1]

    def test_one_robot_without_ground_truth_leaves_the_others_judged(self):
        metrics = self.run(truth={r: TRUTH[r] for r in ("alpha", "beta")})
        assert metrics["ate_m"]["team"] == pytest.approx(0.0, abs=1e-9)
        assert metrics["ate_m"]["gamma"] is None
        assert metrics["alignment"]["alpha-gamma"]["rotation_error_deg"] is None

    def test_no_closures_and_no_pairs(self):
        metrics = self.run(filtered=FilterResult("none", (), 0), closures=[])
        assert metrics["closures"]["accepted_true"] == 0
        assert metrics["candidates"]["recall"] is None
