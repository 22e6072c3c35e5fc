"""Ground truth of bodies whose axes are not the LiDAR's."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.pipeline.evaluation.body_axes import body_rotation, in_lidar_axes
from wiclosure.pipeline.evaluation.errors import Matched
from wiclosure.pipeline.evaluation.evaluate import Findings, evaluate
from wiclosure.pipeline.evaluation.metrics import CostMetrics
from wiclosure.pipeline.evaluation.settings import EvaluationSettings
from wiclosure.types import Closure, FilterResult, KeyframeId, Stage, Trajectory

SECOND = 1_000_000_000
CAMERA = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # its x right, y down, z ahead, in the LiDAR
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0])


def drive(seed: int, robot: str = "alpha", n: int = 200, yaw: float = 0.15) -> Trajectory:
    """A vehicle that only drives ahead and steers, on level ground."""
    rng = np.random.default_rng(seed)
    step = np.zeros((n - 1, 6))
    step[:, 2], step[:, 3] = rng.normal(0, yaw, n - 1), rng.uniform(0.5, 1.0, n - 1)
    poses = [se3.from_yaw(rng.uniform(-3, 3), rng.normal(0, 30, 3) * [1, 1, 0])]
    for T in se3.exp(step):
        poses.append(poses[-1] @ T)
    return Trajectory(robot, np.arange(n, dtype=np.int64) * SECOND, np.stack(poses))


def noisy(trajectory: Trajectory, seed: int, sigma_m: float = 0.03, sigma_rad: float = 0.005) -> Trajectory:
    sigma = np.repeat([sigma_rad, sigma_m], 3)
    noise = np.random.default_rng(seed).normal(0, 1, (len(trajectory), 6)) * sigma
    return Trajectory(trajectory.robot, trajectory.stamps_ns, trajectory.poses @ se3.exp(noise))


def in_axes(trajectory: Trajectory, R_lidar_body: np.ndarray) -> Trajectory:
    T_lidar_body = se3.from_rotation_translation(R_lidar_body, np.zeros(3))
    return Trajectory(trajectory.robot, trajectory.stamps_ns, trajectory.poses @ T_lidar_body)


def unturned(trajectory: Trajectory) -> Trajectory:
    poses = trajectory.poses.copy()
    poses[:, :3, :3] = np.eye(3)
    return Trajectory(trajectory.robot, trajectory.stamps_ns, poses)


def degrees_between(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(Rotation.from_matrix(a.T @ b).magnitude()))


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_any_mounting_is_found_although_the_vehicle_only_drives_and_steers(seed: int) -> None:
    true, R_lidar_body = drive(seed), Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
    truth = in_axes(true, R_lidar_body)
    found = body_rotation(Matched("alpha", noisy(true.moved(truth.poses[7]), seed).poses, truth.poses))
    assert found is not None
    R_truth_lidar, certain = found
    assert certain
    assert degrees_between(R_truth_lidar, R_lidar_body.T) < 4.0


@pytest.mark.parametrize("n", [100, 3000])
def test_noise_does_not_pass_for_steering(n: int) -> None:
    true = drive(1, n=n, yaw=0.0)
    truth = noisy(in_axes(true, CAMERA), 2)
    found = body_rotation(Matched("alpha", noisy(true, 3).poses, truth.poses))
    assert found is not None
    assert not found[1]


@pytest.mark.parametrize("n", [1, 5])
def test_short_paths_tell_nothing(n: int) -> None:
    true = drive(1, n=n)
    assert body_rotation(Matched("alpha", true.poses, in_axes(true, CAMERA).poses)) is None


def test_ground_truth_of_something_else_tells_nothing() -> None:
    assert body_rotation(Matched("alpha", drive(1).poses, drive(2).poses @ noisy(drive(3), 4, 1, 1).poses)) is None


@pytest.mark.parametrize("yaw", [0.0, 0.15])
@pytest.mark.parametrize("mounting_deg", [0.0, 6.0])
def test_like_axes_are_left_as_they_are(yaw: float, mounting_deg: float) -> None:
    true = drive(1, yaw=yaw)
    truth = in_axes(true, Rotation.from_euler("z", mounting_deg, degrees=True).as_matrix())
    oriented = in_lidar_axes({"alpha": noisy(true, 2)}, {"alpha": truth}, 1.0)
    assert oriented.truth["alpha"] is truth
    assert not oriented.remarks
    assert not oriented.unoriented


def test_a_straight_path_in_other_axes_is_judged_by_positions_alone() -> None:
    true = drive(1, yaw=0.0)
    oriented = in_lidar_axes({"alpha": true}, {"alpha": in_axes(true, CAMERA)}, 1.0)
    assert oriented.unoriented == {"alpha"}
    assert oriented.oriented == {}
    assert "turns too little" in oriented.remarks[0]


TRUE = {"alpha": drive(5), "beta": drive(6, "beta")}


def figures(truth: dict[str, Trajectory]):
    closures = [
        Closure.from_measurement(
            KeyframeId("alpha", n),
            KeyframeId("beta", 2 * n),
            se3.between(TRUE["alpha"].poses[n], TRUE["beta"].poses[2 * n]),
            np.eye(6),
        ).accepted(Stage.ESTIMATE)
        for n in range(10)
    ]
    found = Findings(
        filtered=FilterResult("none", (), 0),
        closures=closures,
        components=(("alpha", "beta"),),
        keyframes={robot: noisy(t, 1, 0.01, 0.001).moved(se3.inverse(t.poses[0])) for robot, t in TRUE.items()},
        odometry=TRUE,
        merged={robot: noisy(t, 1, 0.01, 0.001) for robot, t in TRUE.items()},
    )
    costs: CostMetrics = {"seconds": {}, "seconds_spent": {}, "bytes_exchanged": None, "peak_rss_mb": None}
    return evaluate(found, truth, EvaluationSettings(), costs=costs)


@pytest.mark.parametrize("axes", [CAMERA, UPSIDE_DOWN, Rotation.from_euler("z", 93, degrees=True).as_matrix()])
def test_true_closures_are_true_in_whatever_axes_ground_truth_is(axes: np.ndarray) -> None:
    metrics = figures({"alpha": in_axes(TRUE["alpha"], axes), "beta": TRUE["beta"]})
    assert (metrics["closures"]["accepted_true"], metrics["closures"]["accepted_false"]) == (10, 0)
    assert metrics["alignment"]["alpha-beta"]["rotation_error_deg"] < 1.0
    assert metrics["rpe"]["alpha"]["translation_m"] < 0.2
    degrees = np.degrees(Rotation.from_matrix(axes).magnitude())
    assert metrics["diagnosis"] == [
        f"ground truth of alpha is of a body turned by {degrees:.0f} degrees against the LiDAR; taken into account"
    ]
    assert metrics["ate_m"] == figures(TRUE)["ate_m"]


def test_without_orientations_only_positions_are_judged() -> None:
    metrics = figures({"alpha": unturned(TRUE["alpha"]), "beta": TRUE["beta"]})
    assert metrics["ate_m"] == figures(TRUE)["ate_m"]
    assert metrics["closures"]["accepted"] == 10
    assert metrics["closures"]["accepted_true"] is metrics["closures"]["accepted_false"] is None
    assert metrics["alignment"]["alpha-beta"]["translation_error_m"] is None
    assert metrics["rpe"]["alpha"]["step_m"] is metrics["rpe"]["alpha"]["rotation_deg"] is None
    assert metrics["rpe"]["beta"]["rotation_deg"] is not None
    assert "ground truth of alpha has no orientations" in metrics["diagnosis"][0]
