from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.pipeline.evaluation.errors import (
    Matched,
    inter_robot_error,
    joint_errors,
    matched,
    relative_errors,
    rigid_alignment,
    rms,
    truth_at,
)
from wiclosure.types import Trajectory

SECOND = 1_000_000_000
SEEDS = st.integers(0, 2**32 - 1)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_alignment_undoes_any_rigid_motion(path, turned, seed):
    truth, T = path(seed), turned(seed)
    np.testing.assert_allclose(rigid_alignment(truth.positions, truth.moved(T).positions), T, atol=1e-8)
    error = joint_errors([Matched("alpha", truth.moved(T).poses, truth.poses)])["alpha"]
    assert np.abs(error).max() < 1e-9


@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_single_robot_errors_agree_with_evo(path, turned, disturbed, seed):
    from evo.core import metrics, trajectory

    truth = path(seed)
    estimate = disturbed(truth, seed).moved(turned(seed))
    robot = Matched("alpha", estimate.poses, truth.poses)

    def as_evo(poses):
        return trajectory.PosePath3D(poses_se3=list(poses))

    aligned = as_evo(estimate.poses)
    aligned.align(as_evo(truth.poses), correct_scale=False)
    absolute = metrics.APE(metrics.PoseRelation.translation_part)
    absolute.process_data((as_evo(truth.poses), aligned))
    ours = rms(joint_errors([robot])["alpha"])
    assert ours == pytest.approx(absolute.get_statistic(metrics.StatisticsType.rmse), rel=1e-9)

    for relation, key in (
        (metrics.PoseRelation.translation_part, "step_m"),
        (metrics.PoseRelation.rotation_angle_deg, "step_deg"),
    ):
        relative = metrics.RPE(relation, delta=1, delta_unit=metrics.Unit.frames, all_pairs=True)
        relative.process_data((as_evo(truth.poses), as_evo(estimate.poses)))
        assert relative_errors(robot, 10.0)[key] == pytest.approx(
            relative.get_statistic(metrics.StatisticsType.rmse), rel=1e-6
        )


def test_relative_error_over_a_distance_sees_a_scale_error(path):
    truth = path(1, 200)
    scaled = Trajectory("alpha", truth.stamps_ns, truth.poses.copy())
    scaled.poses[:, :3, 3] *= 1.01
    errors = relative_errors(Matched("alpha", scaled.poses, truth.poses), 10.0)
    assert errors["rotation_deg"] == pytest.approx(0.0, abs=1e-6)
    assert 0.5 < errors["translation_percent"] <= 1.0 + 1e-9  # displacement is at most the way driven
    short = relative_errors(Matched("alpha", truth.poses[:3], truth.poses[:3]), 1000.0)
    assert short["translation_m"] is None
    assert short["step_m"] == pytest.approx(0.0, abs=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, shift=st.floats(0.5, 50.0))
def test_one_alignment_for_the_team_shows_what_alignments_of_each_robot_hide(path, seed, shift):
    a, b = path(seed), path(seed + 1, robot="beta")
    displaced = b.moved(se3.from_yaw(0.0, np.array([shift, 0.0, 0.0])))
    robots = [Matched("alpha", a.poses, a.poses), Matched("beta", displaced.poses, b.poses)]
    assert all(rms(joint_errors([robot])[robot.robot]) < 1e-9 for robot in robots)
    team = joint_errors(robots)
    assert rms(np.concatenate(list(team.values()))) > 1e-3 * shift
    metres, degrees = inter_robot_error(*robots)
    assert metres == pytest.approx(shift, rel=1e-6)
    assert degrees == pytest.approx(0.0, abs=1e-5)


def test_inter_robot_error_is_defined_on_a_straight_path():
    line = np.tile(np.eye(4), (50, 1, 1))
    line[:, 0, 3] = np.arange(50)
    rolled = line.copy()
    rolled[:, :3, :3] = Rotation.from_euler("x", 10, degrees=True).as_matrix()
    metres, degrees = inter_robot_error(Matched("alpha", line, line), Matched("beta", rolled, line))
    assert metres == pytest.approx(0.0, abs=1e-9)
    assert degrees == pytest.approx(10.0, abs=1e-6)


def test_ground_truth_is_used_only_where_it_is_near_in_time(path):
    truth = Trajectory("alpha", np.array([0, 1, 2, 10, 11], dtype=np.int64) * SECOND, path(0, 5).poses)
    stamps = np.array([-1.0, 0, 0.5, 2, 6, 10.5, 11, 12]) * SECOND
    _, covered = truth_at(truth, stamps.astype(np.int64), 1.0)
    assert covered.tolist() == [False, True, True, True, False, True, True, False]
    assert len(matched(path(0), None, 1.0)) == 0
