"""Ranges and bearings in the pose graph: right by finite differences, of use, and harmless where they are wrong."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from pydantic import ValidationError

from wiclosure import se3
from wiclosure.backends.config import PoseGraphSettings
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.factor_graph.factors import Keys
from wiclosure.backends.factor_graph.radio_factors import radio_factors
from wiclosure.backends.graph_files.g2o_writer import write_g2o
from wiclosure.types import KeyframeId, RadioLinks, Stage

RANGE_SIGMA_M, BEARING_SIGMA_RAD = 0.3, 0.05
RADIO = PoseGraphSettings(radio=True)


def links(team, count, seed=0, *, noise=1.0, bearings=True):
    """What alpha and beta measure at random keyframes, antennas a foot off; every other time beta receives."""
    rng = np.random.default_rng(seed)
    index_a, index_b = rng.integers(0, len(team.truth["alpha"]), (2, count))
    arm_a, arm_b = rng.normal(0, 0.3, (2, count, 3))
    T_world_a, T_world_b = team.truth["alpha"].poses[index_a], team.truth["beta"].poses[index_b]
    a, b = se3.transform(T_world_a, arm_a), se3.transform(T_world_b, arm_b)
    a_receives = np.arange(count) % 2 == 0
    R_world_receiver = np.where(a_receives[:, None, None], T_world_a[:, :3, :3], T_world_b[:, :3, :3])
    seen = np.einsum("lji,lj->li", R_world_receiver, np.where(a_receives[:, None], b - a, a - b))
    distance = np.linalg.norm(seen, axis=1)
    unit = seen / distance[:, None] + noise * rng.normal(0, BEARING_SIGMA_RAD, (count, 3))
    T_odom = {robot: team.T_world_odom[robot] for robot in ("alpha", "beta")}
    return RadioLinks(
        "alpha",
        "beta",
        se3.between(T_odom["alpha"], T_odom["beta"]) @ se3.from_yaw(0.1, np.array([1.0, -1.0, 0.0])),
        np.diag(np.square([0.03, 0.03, 3.0, 1e4, 1e4, 3.0])),
        index_a,
        index_b,
        arm_a,
        arm_b,
        a_receives,
        distance + noise * rng.normal(0, RANGE_SIGMA_M, count),
        np.full(count, RANGE_SIGMA_M),
        unit / np.linalg.norm(unit, axis=1, keepdims=True) if bearings else np.full((count, 3), np.nan),
        np.broadcast_to(BEARING_SIGMA_RAD**2 * np.eye(3), (count, 3, 3)),
    )


def values(team):
    found = gtsam.Values()
    for robot, t in team.truth.items():
        for key, pose in zip(Keys(tuple(team.truth)).all(robot, np.arange(len(t))), t.poses, strict=True):
            found.insert(key, gtsam.Pose3(pose))
    return found


def test_true_poses_leave_no_error_and_derivatives_are_those_of_finite_differences(team_maker):
    team = team_maker(1)
    at = values(team)
    level, *exact = radio_factors([links(team, 12, noise=0.0)], team.odometry, Keys(tuple(team.truth)))
    assert level.error(at) < 1e-2  # the frames are as level as they are said to be, and the rest is open
    assert len(exact) == 24
    for factor in exact:
        assert factor.error(at) < 1e-18
        slopes = np.empty((factor.dim(), 12))
        for column, key in enumerate(np.repeat(factor.keys(), 6).tolist()):
            step = np.zeros(6)
            step[column % 6] = 1e-6
            moved = gtsam.Values(at)
            moved.update(key, at.atPose3(key).retract(step))
            slopes[:, column] = (factor.unwhitenedError(moved) - factor.unwhitenedError(at)) / 1e-6
        whitened, _ = factor.linearize(at).jacobian()
        sigma = RANGE_SIGMA_M if factor.dim() == 1 else BEARING_SIGMA_RAD
        np.testing.assert_allclose(sigma * whitened, slopes, atol=1e-4)


def placed_wrongly_m(team, result):
    """Mean distance of beta's keyframes from where they really were, seen from alpha's frame."""
    truth = se3.inverse(team.truth["alpha"].poses[0]) @ team.truth["beta"].poses
    return np.linalg.norm(result.trajectories["beta"].positions - truth[:, :3, 3], axis=1).mean()


def test_robots_that_no_closure_joins_are_joined_by_radio(team_maker):
    for seed in range(5):
        team = team_maker(seed, noise=1.0)
        result = optimise(team.odometry, [], RADIO, [links(team, 20, seed)])
        assert result.components == (("alpha", "beta"),)
        assert result.unconnected == ()
        assert placed_wrongly_m(team, result) < 2.0
        assert np.isfinite(result.relative_covariance(KeyframeId("alpha", 3), KeyframeId("beta", 7))).all()


def test_radio_helps_where_closures_are_at_one_end_only(team_maker):
    without, with_radio = [], []
    for seed in range(8):
        team = team_maker(seed, n=150, noise=2.0)
        rng = np.random.default_rng(seed)
        closures = [team.closure(("alpha", i), ("beta", i), noise=rng) for i in range(3)]
        without.append(placed_wrongly_m(team, optimise(team.odometry, closures, RADIO)))
        with_radio.append(placed_wrongly_m(team, optimise(team.odometry, closures, RADIO, [links(team, 60, seed)])))
    assert np.median(with_radio) < 0.7 * np.median(without)


def test_gross_ranges_do_little_harm(team_maker):
    team = team_maker(2, noise=1.0)
    heard = links(team, 40)
    wrong = heard.range_m + np.where(np.arange(40) % 8 == 0, 15.0, 0.0)
    good = placed_wrongly_m(team, optimise(team.odometry, [], RADIO, [heard]))
    spoiled = placed_wrongly_m(team, optimise(team.odometry, [], RADIO, [replace(heard, range_m=wrong)]))
    assert spoiled < good + 0.3


def test_a_false_closure_is_still_rejected(team_maker):
    team, rng = team_maker(3, noise=1.0), np.random.default_rng(3)
    closures = [team.closure(("alpha", i), ("beta", i), noise=rng) for i in range(0, 30, 5)]
    false = team.closure(("alpha", 40), ("beta", 50), error=np.array([0, 0, 1.0, 8.0, -5.0, 0.0]))
    result = optimise(team.odometry, [*closures, false], RADIO, [links(team, 20)])
    assert [c.rejected_at for c in result.closures] == [None] * 6 + [Stage.ESTIMATE]


def test_radio_counts_only_where_it_is_asked_for(team_maker, tmp_path):
    team, rng = team_maker(4, noise=1.0), np.random.default_rng(4)
    closures = [team.closure(("alpha", i), ("beta", i), noise=rng) for i in range(1, 30, 5)]
    heard = [links(team, 10)]
    plain = optimise(team.odometry, closures, PoseGraphSettings())
    same = optimise(team.odometry, closures, PoseGraphSettings(), heard)
    for robot, t in plain.trajectories.items():
        np.testing.assert_array_equal(same.trajectories[robot].poses, t.poses)
    write_g2o(optimise(team.odometry, closures, RADIO, heard), tmp_path / "graph.g2o")
    written = (tmp_path / "graph.g2o").read_text()
    assert written.count("\nEDGE_SE3:QUAT") == 2 * 59 + 6
    assert "# 20 ranges and bearings, and what gravity tells, are not in this file" in written
    with pytest.raises(ValidationError, match="set optimiser: joint"):
        PoseGraphSettings(radio=True, optimiser="two-stage")


def test_ranges_alone_count(team_maker):
    team = team_maker(5, noise=0.5)
    result = optimise(team.odometry, [], RADIO, [links(team, 60, bearings=False)])
    assert placed_wrongly_m(team, result) < 1.0
