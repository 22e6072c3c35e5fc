from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.evaluation.body_axes import OrientedTruth
from wiclosure.pipeline.evaluation.trajectories import odometry_errors, trajectory_metrics
from wiclosure.types import FrameAlignment

ROBOTS = ("alpha", "beta", "gamma")
TOGETHER = (ROBOTS,)


@pytest.fixture
def truth(path):
    return {robot: path(seed, robot=robot) for seed, robot in enumerate(ROBOTS)}


def metrics(merged, truth, components=TOGETHER, unoriented=(), **options):
    oriented = OrientedTruth(truth, frozenset(unoriented), ("a remark",))
    return trajectory_metrics(merged, components, oriented, gap_s=1.0, rpe_distance_m=10.0, **options)


def test_one_displaced_robot_shows_between_robots_and_in_the_team_but_not_in_its_own_error(truth):
    shifted = truth | {"gamma": truth["gamma"].moved(se3.from_yaw(0.0, np.array([3.0, 4.0, 0.0])))}
    found = metrics(shifted, truth)
    assert found["ate_own_m"] == {robot: pytest.approx(0.0, abs=1e-9) for robot in ROBOTS}
    assert found["alignment"]["alpha-beta"]["translation_error_m"] == pytest.approx(0.0, abs=1e-9)
    for pair in ("alpha-gamma", "beta-gamma"):
        assert found["alignment"][pair]["translation_error_m"] == pytest.approx(5.0)
    assert 0.5 < found["ate_m"]["team"] < 5.0
    assert found["rpe"]["gamma"]["step_m"] == pytest.approx(0.0, abs=1e-9)


def test_components_are_aligned_one_by_one(truth):
    apart = truth | {"gamma": truth["gamma"].moved(se3.from_yaw(2.0, np.array([100.0, 0.0, 0.0])))}
    found = metrics(apart, truth, (("alpha", "beta"), ("gamma",)))
    assert found["ate_m"] == {"team": None} | {robot: pytest.approx(0.0, abs=1e-9) for robot in ROBOTS}
    assert [part["ate_m"] for part in found["components"]] == [pytest.approx(0.0, abs=1e-9)] * 2
    assert found["alignment"]["beta-gamma"]["translation_error_m"] is None
    assert found["diagnosis"][0] == "a remark"
    assert found["diagnosis"][1].endswith("each group aligned on its own: alpha and beta 0.00 m; gamma 0.00 m")


def test_ground_truth_without_orientations_gives_positions_only(truth):
    found = metrics(truth, truth, unoriented={"beta"})
    assert found["ate_m"]["beta"] == pytest.approx(0.0, abs=1e-9)
    assert found["rpe"]["beta"]["step_m"] is None
    assert found["alignment"]["alpha-beta"]["rotation_error_deg"] is None
    assert found["alignment"]["alpha-gamma"]["rotation_error_deg"] == pytest.approx(0.0, abs=1e-5)


def test_robots_without_ground_truth_and_with_that_of_another_day_are_named(truth):
    late = replace(truth["gamma"], stamps_ns=truth["gamma"].stamps_ns + 10**14)
    found = metrics(truth, {"alpha": truth["alpha"], "gamma": late})
    assert found["diagnosis"][1:] == [
        "no ground truth for beta: no errors are given there",
        "ground truth of gamma does not overlap with the recording in time",
    ]
    assert found["ate_m"]["beta"] is found["ate_m"]["gamma"] is None
    assert set(found["rpe"]) == {"alpha"}


def test_what_the_radio_left_open_stands_beside_the_error(truth):
    alignments = (
        FrameAlignment("beta", "alpha", None, None, True, "two walls"),
        FrameAlignment("beta", "gamma", None, None, False, "eight links"),
    )
    found = metrics(truth, truth, alignments=alignments)["alignment"]
    assert [found[pair]["ambiguous"] for pair in ("alpha-beta", "alpha-gamma", "beta-gamma")] == [True, None, False]


def test_odometry_is_judged_in_its_own_frame(truth):
    odometry = {robot: t.moved(se3.inverse(t.poses[0])) for robot, t in truth.items()}
    bent = odometry["alpha"].poses.copy()
    bent[:, 2, 3] += 0.5 * (-1.0) ** np.arange(80)
    odometry["alpha"] = replace(odometry["alpha"], poses=bent)
    found = odometry_errors(odometry, OrientedTruth(truth, frozenset(), ()), gap_s=1.0)
    assert found["alpha"] == pytest.approx(0.5, rel=0.02)
    assert found["beta"] == pytest.approx(0.0, abs=1e-9)
    assert found["team"] == pytest.approx(found["alpha"] / np.sqrt(3), rel=1e-6)  # of three equally long paths
    assert odometry_errors(odometry, OrientedTruth({}, frozenset(), ()), gap_s=1.0) == dict.fromkeys(("team", *ROBOTS))
