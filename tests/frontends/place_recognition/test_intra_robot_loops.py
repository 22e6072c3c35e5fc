from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.frontends.config import IntraRobotLoopSettings
from wiclosure.frontends.place_recognition.intra_robot_loops import intra_robot_loops
from wiclosure.types import PredictionKind, Trajectory


def laps(count: int, drift: DriftModel) -> Trajectory:
    """Rounds of a circle of 100 m, a keyframe every metre."""
    angle = np.arange(100 * count) * 2 * np.pi / 100
    radius_m = 100 / (2 * np.pi)
    positions = np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle), 0 * angle], axis=1)
    return Trajectory("alpha", np.arange(len(angle)) * 10**9, se3.from_yaw(angle + np.pi / 2, positions), drift)


def test_a_second_lap_closes_on_the_first_and_neighbours_do_not() -> None:
    path = laps(2, DriftModel(translation_walk=1e-4, rotation_walk=1e-6, rotation_walk_turning=1e-6))
    pairs = intra_robot_loops(path, IntraRobotLoopSettings(min_travel_m=50.0, radius_m=5.0))
    assert (pairs.robot_a, pairs.robot_b) == ("alpha", "alpha")
    apart = np.linalg.norm(path.positions[:, None] - path.positions[None], axis=2)
    i, j = np.nonzero((apart <= 5.0) & (path.distance[None] - path.distance[:, None] >= 50.0))
    assert {*zip(pairs.index_a.tolist(), pairs.index_b.tolist(), strict=True)} == {
        *zip(i.tolist(), j.tolist(), strict=True)
    }
    predicted = pairs.predicted(np.arange(len(pairs)))
    assert predicted is not None
    assert pairs.predicts is PredictionKind.POSE
    np.testing.assert_allclose(predicted[0], path.relative_pose(pairs.index_a, pairs.index_b))


def test_the_more_odometry_drifts_the_more_pairs_may_be_loops() -> None:
    settings = IntraRobotLoopSettings(min_travel_m=50.0, radius_m=5.0)
    sure, vague = (len(intra_robot_loops(laps(2, DriftModel(translation_walk=w)), settings)) for w in (0.01, 1.0))
    assert sure < vague


def test_a_short_path_has_no_loops() -> None:
    assert len(intra_robot_loops(laps(1, DriftModel()).subset(np.arange(10)), IntraRobotLoopSettings())) == 0
