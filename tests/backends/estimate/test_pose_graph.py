from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.config import ClosureNoise, PcmSettings, PoseGraphSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.backends.estimate.graph_result import propagate_to_scans
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.backends.factor_graph.factors import odometry_covariances
from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.types import KeyframeId, Stage, Trajectory, survivors

SEEDS = st.integers(0, 2**32 - 1)
EVERY_WAY = [
    PoseGraphSettings(optimiser=optimiser, robust=robust)
    for optimiser in ("joint", "two-stage")
    for robust in ("gnc", "cauchy", "none")
]
TIGHT = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)


def in_first_frame(team, robot):
    """Truth in the odometry frame of the first robot, whose odometry starts at identity."""
    return se3.inverse(next(iter(team.truth.values())).poses[0]) @ team.truth[robot].poses


@pytest.mark.parametrize("way", EVERY_WAY, ids=lambda s: f"{s.optimiser}-{s.robust}")
@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_perfect_input_gives_the_exact_answer(team_maker, way, seed):
    team, rng = team_maker(seed, ("alpha", "beta", "gamma"), 30), np.random.default_rng(seed)
    closures = team.random_closures(4, rng) + team.random_closures(4, rng, "beta", "gamma")
    result = optimise(team.odometry, closures, way)
    assert result.components == (("alpha", "beta", "gamma"),)
    assert all(c.survived(Stage.ESTIMATE) for c in result.closures)
    for robot in team.odometry:
        np.testing.assert_allclose(result.trajectories[robot].poses, in_first_frame(team, robot), atol=1e-5)
        T_world_odom = result.T_world_odom[robot]
        np.testing.assert_allclose(T_world_odom @ team.odometry[robot].poses, in_first_frame(team, robot), atol=1e-5)


@settings(max_examples=5, deadline=None)
@given(seed=SEEDS)
def test_the_estimate_does_not_depend_on_a_robots_odometry_frame(team_maker, seed):
    team, rng = team_maker(seed, n=30, noise=1.0), np.random.default_rng(seed)
    closures = team.random_closures(8, rng, noise=rng)
    elsewhere = se3.from_yaw(rng.uniform(-3, 3), rng.normal(size=3) * 100.0)
    moved = team.odometry | {"beta": team.odometry["beta"].moved(elsewhere)}
    here, there = (optimise(odometry, closures, PoseGraphSettings()) for odometry in (team.odometry, moved))
    for robot in team.odometry:
        np.testing.assert_allclose(here.trajectories[robot].poses, there.trajectories[robot].poses, atol=1e-4)
    np.testing.assert_allclose(here.T_world_odom["beta"], there.T_world_odom["beta"] @ elsewhere, atol=2e-2)


def test_the_first_pose_of_the_first_robot_stays_where_its_odometry_has_it(team_maker):
    team, rng = team_maker(1, noise=1.0), np.random.default_rng(1)
    start = se3.from_yaw(1.0, np.array([5.0, -3.0, 1.0]))
    odometry = team.odometry | {"alpha": team.odometry["alpha"].moved(start)}
    result = optimise(odometry, team.random_closures(10, rng, noise=rng), PoseGraphSettings())
    np.testing.assert_allclose(result.trajectories["alpha"].poses[0], start, atol=1e-6)
    assert np.abs(result.trajectories["alpha"].poses[-1] - odometry["alpha"].poses[-1]).max() > 1e-4


@pytest.mark.parametrize("robust", ["gnc", "cauchy"])
def test_false_closures_are_switched_off_with_a_reason(team_maker, robust):
    team, rng = team_maker(2, noise=1.0), np.random.default_rng(2)
    true = team.random_closures(20, rng, noise=rng)
    false = [team.false_closure(("alpha", int(i)), ("beta", int(j)), rng) for i, j in rng.integers(0, 60, (8, 2))]
    result = optimise(team.odometry, true + false, PoseGraphSettings(robust=robust))
    assert [c.rejected_at for c in result.closures[20:]] == [Stage.ESTIMATE] * 8
    assert len(survivors(result.closures[:20], Stage.ESTIMATE)) >= 19
    assert "contradicts the joint estimate" in result.closures[20].reason
    error = result.trajectories["beta"].positions - in_first_frame(team, "beta")[:, :3, 3]
    assert np.linalg.norm(error, axis=1).max() < 1.0


@pytest.mark.parametrize("robust", ["gnc", "cauchy"])
def test_most_closures_may_be_false(team_maker, robust):
    team, rng = team_maker(10, n=300, noise=1.0), np.random.default_rng(10)
    true = team.random_closures(20, rng, noise=rng)
    false = [team.false_closure(("alpha", int(i)), ("beta", int(j)), rng) for i, j in rng.integers(0, 300, (40, 2))]
    result = optimise(team.odometry, false + true, PoseGraphSettings(robust=robust))
    accepted = [c.survived(Stage.ESTIMATE) for c in result.closures]
    assert not any(accepted[:40])
    assert sum(accepted[40:]) >= 18


@settings(max_examples=5, deadline=None)
@given(seed=SEEDS, order=st.permutations(["alpha", "beta", "gamma", "delta"]))
def test_renaming_or_reordering_robots_changes_nothing(team_maker, seed, order):
    team, rng = team_maker(seed, ("alpha", "beta", "gamma", "delta"), noise=1.0), np.random.default_rng(seed)
    closures = []
    for a, b in (("alpha", "beta"), ("beta", "gamma"), ("gamma", "delta"), ("alpha", "alpha")):
        closures += team.random_closures(8, rng, a, b, noise=rng)
        closures += [team.false_closure((a, int(i)), (b, int(j)), rng) for i, j in rng.integers(0, 60, (4, 2))]
    new = dict(zip(team.odometry, order, strict=True))
    renamed = [
        replace(c, query=replace(c.query, robot=new[c.query.robot]), match=replace(c.match, robot=new[c.match.robot]))
        for c in closures
    ]
    odometry = {new[r]: replace(team.odometry[r], robot=new[r]) for r in sorted(team.odometry, reverse=True)}
    one, other = (
        optimise(trajectories, pairwise_consistent(given_, trajectories, PcmSettings()).closures, way)
        for trajectories, given_, way in (
            (team.odometry, closures, PoseGraphSettings()),
            (odometry, renamed, PoseGraphSettings(anchor=new["alpha"])),
        )
    )
    assert [(c.rejected_at, c.reason) for c in one.closures] == [(c.rejected_at, c.reason) for c in other.closures]
    for robot in team.odometry:
        if robot in one.components[0]:
            poses = other.trajectories[new[robot]].poses
            np.testing.assert_allclose(one.trajectories[robot].poses, poses, atol=1e-3)


def test_the_anchor_can_be_chosen(team_maker):
    team, rng = team_maker(11, ("alpha", "beta", "gamma")), np.random.default_rng(11)
    closures = team.random_closures(6, rng) + team.random_closures(6, rng, "beta", "gamma")
    result = optimise(team.odometry, closures, PoseGraphSettings(anchor="gamma"))
    assert result.components[0][0] == "gamma"
    np.testing.assert_allclose(result.trajectories["gamma"].poses[0], team.odometry["gamma"].poses[0], atol=1e-6)
    with pytest.raises(InputError, match="the robots are alpha, beta, gamma"):
        optimise(team.odometry, closures, PoseGraphSettings(anchor="omega"))


def test_sigma_scale_moves_no_pose_but_the_limit_and_the_marginals(team_maker):
    team, rng = team_maker(12, noise=1.0), np.random.default_rng(12)
    closures = team.random_closures(12, rng, noise=rng)
    off = team.closure(("alpha", 20), ("beta", 20), error=np.array([0, 0, 0, 2.0, 0, 0]))
    stated, doubled = (
        optimise(team.odometry, [*closures, off], PoseGraphSettings(sigma_scale=scale)) for scale in (1.0, 4.0)
    )
    assert [r.closures[-1].survived(Stage.ESTIMATE) for r in (stated, doubled)] == [False, True]
    one, other = (
        optimise(team.odometry, closures, PoseGraphSettings(sigma_scale=scale, robust="none")) for scale in (1.0, 4.0)
    )
    np.testing.assert_allclose(one.trajectories["beta"].poses, other.trajectories["beta"].poses, atol=1e-9)
    np.testing.assert_allclose(16 * one.covariances("beta", [30]), other.covariances("beta", [30]), rtol=1e-6)


def test_relative_covariances_of_neighbours_are_small_and_those_across_robots_are_not(team_maker):
    team, rng = team_maker(13, ("alpha", "beta", "gamma"), noise=1.0), np.random.default_rng(13)
    result = optimise(team.odometry, team.random_closures(6, rng, noise=rng), PoseGraphSettings())
    near = result.relative_covariance(KeyframeId("beta", 30), KeyframeId("beta", 31))
    step = odometry_covariances(team.odometry["beta"], np.arange(60), np.zeros(0, np.int64))[30]
    assert np.trace(near) <= 1.01 * np.trace(step)
    across = result.relative_covariance(KeyframeId("alpha", 0), KeyframeId("beta", 30))
    np.testing.assert_allclose(across, result.covariances("beta", [30])[0], rtol=0.01, atol=1e-6)
    assert not result.relative_covariance(KeyframeId("beta", 3), KeyframeId("beta", 3)).any()
    with pytest.raises(InputError, match="nothing connects alpha to gamma"):
        result.relative_covariance(KeyframeId("alpha", 0), KeyframeId("gamma", 0))


def test_closures_within_one_robot_correct_its_drift(team_maker):
    team, rng = team_maker(3, ("alpha",), 200, noise=3.0), np.random.default_rng(3)
    ends = [(i, 199 - i) for i in range(0, 90, 10)]
    closures = [team.closure(("alpha", a), ("alpha", b), noise=rng) for a, b in ends]
    result = optimise(team.odometry, closures, PoseGraphSettings(robust="none"))
    truth = in_first_frame(team, "alpha")[:, :3, 3]
    before, after = (
        np.linalg.norm(t.positions - truth, axis=1)[-1] for t in (team.odometry["alpha"], result.trajectories["alpha"])
    )
    assert after < 0.5 * before


def test_robots_without_closures_stay_in_their_own_frame_and_are_reported(team_maker):
    team, rng = team_maker(4, ("alpha", "beta", "gamma", "delta")), np.random.default_rng(4)
    closures = team.random_closures(4, rng, "gamma", "beta")
    result = optimise(team.odometry, closures, PoseGraphSettings())
    assert result.components == (("alpha",), ("beta", "gamma"), ("delta",))
    assert result.unconnected == ("beta", "gamma", "delta")
    np.testing.assert_allclose(result.trajectories["delta"].poses, team.odometry["delta"].poses, atol=1e-6)
    np.testing.assert_allclose(result.trajectories["beta"].poses, team.odometry["beta"].poses, atol=1e-5)
    assert "there is no closure between delta and other robots: it stays in its own frame" in result.diagnosis


def test_robots_whose_closures_were_all_rejected_are_told_apart_from_those_without(team_maker):
    team, rng = team_maker(4, ("alpha", "beta")), np.random.default_rng(4)
    rejected = [replace(c, rejected_at=Stage.CONSISTENCY, reason="false") for c in team.random_closures(3, rng)]
    said = optimise(team.odometry, rejected, PoseGraphSettings()).diagnosis
    assert "no accepted closure connects beta to alpha: it stays in its own frame" in said


def test_robots_whose_closures_all_prove_false_go_back_to_their_own_frame(team_maker):
    team, rng = team_maker(5, ("alpha", "beta", "gamma")), np.random.default_rng(5)
    true = team.random_closures(8, rng) + team.random_closures(8, rng, "beta", "gamma")
    # Two closures of alpha and gamma that contradict the way over beta.
    false = [team.closure(("alpha", i), ("gamma", i), error=np.array([0, 0, 1.0, 9.0, 0, 0])) for i in (5, 30)]
    result = optimise(team.odometry, true + false, PoseGraphSettings())
    assert [c.rejected_at for c in result.closures[16:]] == [Stage.ESTIMATE] * 2
    lone = [team.false_closure(("alpha", i), ("beta", 60 - i), rng) for i in (3, 29, 55)]
    result = optimise(team.odometry, lone, PoseGraphSettings())
    for robot in {"alpha", "beta", "gamma"} - set(result.components[0]):
        np.testing.assert_allclose(result.trajectories[robot].poses[0], team.odometry[robot].poses[0], atol=1e-5)


@pytest.mark.parametrize("way", EVERY_WAY, ids=lambda s: f"{s.optimiser}-{s.robust}")
def test_degenerate_input_never_raises_and_stays_finite(team_maker, way):
    team = team_maker(6, n=5)
    one = {r: t.subset(np.array([2])) for r, t in team.odometry.items()}
    still = {
        r: Trajectory(r, t.stamps_ns, np.broadcast_to(np.eye(4), (5, 4, 4)).copy()) for r, t in team.odometry.items()
    }
    singular = team.remeasured(team.closure(("alpha", 0), ("beta", 0)), covariance=np.zeros((6, 6)))
    huge = team.remeasured(singular, covariance=np.eye(6) * 1e12)
    opposite = team.remeasured(singular, T_query_match=se3.from_yaw(np.pi, np.array([1e6, 0.0, 0.0])))
    for odometry in (one, still, {"beta": one["beta"], "alpha": still["alpha"]}):
        for closures in ([], [singular], [huge], [singular, opposite], [singular, singular, huge, opposite]):
            result = optimise(odometry, closures, way)
            assert all(np.isfinite(t.poses).all() for t in result.trajectories.values())
            assert len(result.closures) == len(closures)


def test_no_trajectory_is_an_error_that_says_what_to_pass():
    with pytest.raises(InputError, match="pass the keyframe trajectory"):
        optimise({}, [], PoseGraphSettings())


def test_the_covariance_of_a_pose_grows_with_the_way_from_the_anchor(team_maker):
    team, rng = team_maker(7, noise=1.0), np.random.default_rng(7)
    result = optimise(team.odometry, team.random_closures(4, rng, noise=rng), PoseGraphSettings())
    sigma = np.sqrt(np.trace(result.covariances("alpha", [0, 10, 59])[:, 3:, 3:], axis1=1, axis2=2))
    assert sigma[0] < 1e-3 < sigma[1] < sigma[2]


def test_chained_steps_have_the_drift_models_covariance_over_each_span():
    drift = DriftModel(rotation_walk=1e-9, rotation_walk_turning=0.0, rotation_bias=0.0)
    poses = se3.from_yaw(0.0, np.arange(101.0)[:, None] * [1.0, 0.0, 0.0])
    trajectory = Trajectory("alpha", np.arange(101, dtype=np.int64) * 10**9, poses, drift)
    steps = odometry_covariances(trajectory, np.arange(101), np.array([40]))
    for first, last in ((0, 40), (40, 100)):
        expected = trajectory.relative_covariance(np.array([first]), np.array([last]))[0, 3:, 3:]
        np.testing.assert_allclose(steps[first:last, 3:, 3:].sum(axis=0), expected, rtol=0.1)


@settings(max_examples=10, deadline=None)
@given(seed=SEEDS)
def test_scans_move_along_with_their_keyframes(team_maker, seed):
    team, rng = team_maker(seed, ("alpha",), 30, noise=1.0), np.random.default_rng(seed)
    scans = team.odometry["alpha"]
    chosen = np.unique(np.concatenate([[0], rng.integers(0, 30, 6)]))
    keyframes = scans.subset(chosen)
    bent = Trajectory("alpha", keyframes.stamps_ns, keyframes.poses @ se3.exp(rng.normal(0, 0.1, (len(chosen), 6))))
    merged = propagate_to_scans(scans, keyframes, bent)
    np.testing.assert_allclose(merged.poses[chosen], bent.poses, atol=1e-9)
    np.testing.assert_allclose(propagate_to_scans(scans, keyframes, keyframes).poses, scans.poses, atol=1e-9)
    frame = se3.from_yaw(1.0, np.array([4.0, 5.0, 6.0]))
    np.testing.assert_allclose(
        propagate_to_scans(scans, keyframes, keyframes.moved(frame)).poses, frame @ scans.poses, atol=1e-8
    )


def test_recorded_graph_with_false_closures_agrees_with_the_clean_decision(data_dir, g2o_loader):
    graph = g2o_loader(data_dir / "pose_graphs/pcm_spoiled/example_2robots")
    result = optimise(graph.odometry, graph.closures, PoseGraphSettings(noise=TIGHT))
    assert [c.survived(Stage.ESTIMATE) for c in result.closures] == [True] * 10 + [False] * 10


def test_four_recorded_robots_come_into_one_frame(data_dir, g2o_loader):
    graph = g2o_loader(data_dir / "pose_graphs/argos_clean/example_4robots")
    noise = ClosureNoise(translation_m=0.3, rotation_rad=0.1)  # what these closures really have
    result = optimise(graph.odometry, graph.closures, PoseGraphSettings(noise=noise))
    assert result.components == (("a", "b", "c", "d"),)
    assert len(result.accepted) > 0.7 * len(graph.closures)
