"""Teams: what third robots settle, and what stated standard deviations do."""

from __future__ import annotations

from dataclasses import replace
from itertools import accumulate, combinations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.config import ClosureNoise, PcmSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.types import Closure, KeyframeId, Trajectory

EXACT = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)


def between(team, a, b, ends, rng, shift=None):
    """Closures between keyframes `ends` of two robots, of b as if its frame were moved by `shift`."""
    closures = [team.closure((a, int(i)), (b, int(j)), noise=rng) for i, j in ends]
    if shift is None:
        return closures
    poses = team.truth[a].poses, shift @ team.truth[b].poses
    return [
        team.remeasured(c, T_query_match=se3.between(poses[0][c.query.index], poses[1][c.match.index]))
        for c in closures
    ]


def live(result):
    return np.array([c.live for c in result.closures])


@pytest.mark.parametrize("seed", range(3))
def test_a_wrong_set_of_one_place_falls_to_a_cycle_of_right_ones(team_maker, seed):
    team, rng = team_maker(seed, ("alpha", "beta", "gamma"), noise=1.0), np.random.default_rng(seed)
    shift = se3.from_yaw(0.4, np.array([20.0, 5.0, 0.0]))
    closures = between(team, "alpha", "beta", [(20 + n, 30 + n) for n in range(10)], rng, shift)
    for robot in ("alpha", "beta"):
        closures += between(team, robot, "gamma", rng.integers(0, 60, (5, 2)), rng)
    kept = live(pairwise_consistent(closures, team.odometry, PcmSettings(noise=EXACT)))
    assert not kept[:10].any()
    assert kept[10:].all()


def test_sets_of_which_nothing_tells_the_wrong_one_are_all_refused(team_maker):
    team, rng = team_maker(4, ("alpha", "beta", "gamma"), noise=1.0), np.random.default_rng(4)
    shift = se3.from_yaw(0.4, np.array([20.0, 5.0, 0.0]))
    closures = between(team, "alpha", "beta", rng.integers(0, 60, (10, 2)), rng, shift)
    for robot in ("alpha", "beta"):
        closures += between(team, robot, "gamma", rng.integers(0, 60, (10, 2)), rng)
    result = pairwise_consistent(closures, team.odometry, PcmSettings(noise=EXACT))
    assert not live(result).any()
    assert all("over a third one" in c.reason for c in result.closures)


def test_an_ambiguous_pair_is_settled_over_a_third_robot(team_maker):
    team, rng = team_maker(5, ("alpha", "beta", "gamma"), noise=1.0), np.random.default_rng(5)
    shift = se3.from_yaw(0.0, np.array([30.0, 0.0, 0.0]))
    right, wrong = (between(team, "alpha", "beta", rng.integers(0, 60, (6, 2)), rng, moved) for moved in (None, shift))
    alone = pairwise_consistent(right + wrong, team.odometry, PcmSettings(noise=EXACT))
    assert not live(alone).any()
    assert any(pair.ambiguous for pair in alone.pairs)
    others = [c for r in ("alpha", "beta") for c in between(team, r, "gamma", rng.integers(0, 60, (6, 2)), rng)]
    kept = live(pairwise_consistent(right + wrong + others, team.odometry, PcmSettings(noise=EXACT)))
    assert kept.tolist() == [True] * 6 + [False] * 6 + [True] * 12


def test_single_closures_hold_where_they_close_a_cycle(team_maker):
    team, rng = team_maker(6, ("alpha", "beta", "gamma"), noise=1.0), np.random.default_rng(6)
    pairs = (("alpha", "beta"), ("beta", "gamma"), ("alpha", "gamma"))
    closures = [c for a, b in pairs for c in between(team, a, b, rng.integers(0, 60, (1, 2)), rng)]
    assert live(pairwise_consistent(closures, team.odometry, PcmSettings(noise=EXACT))).all()
    false = team.false_closure(("alpha", 5), ("gamma", 40), rng)
    assert not live(pairwise_consistent([*closures[:2], false], team.odometry, PcmSettings(noise=EXACT))).any()


@pytest.mark.parametrize("count", [10, 60])
def test_true_closures_are_all_kept_as_sets_grow(team_maker, count):
    for seed in range(3):
        team, rng = team_maker(seed, noise=1.0), np.random.default_rng(seed)
        closures = between(team, "alpha", "beta", rng.integers(0, 60, (count, 2)), rng)
        assert live(pairwise_consistent(closures, team.odometry, PcmSettings(noise=EXACT))).all()


@pytest.mark.parametrize("max_scale", [1.0, 10.0])
@pytest.mark.parametrize("count", [2, 10, 100])
def test_of_unrelated_closures_none_is_accepted_under_any_scale(team_maker, count, max_scale):
    for seed in range(3):
        team, rng = team_maker(seed, noise=1.0), np.random.default_rng(seed)
        ends = rng.integers(0, 60, (count, 2))
        closures = [team.false_closure(("alpha", int(i)), ("beta", int(j)), rng) for i, j in ends]
        result = pairwise_consistent(closures, team.odometry, PcmSettings(noise=EXACT, max_scale=max_scale))
        assert not live(result).any()


@pytest.mark.parametrize("false", [0, 10])
def test_closures_without_information_are_kept_under_the_scale_that_they_show(team_maker, false):
    """Edges that state nothing are read as known to a metre and a radian: under that, anything agrees."""
    kept = []
    for seed in range(3):
        team, rng = team_maker(seed, noise=1.0), np.random.default_rng(seed)
        closures = between(team, "alpha", "beta", rng.integers(0, 60, (10, 2)), rng)
        ends = rng.integers(0, 60, (false, 2))
        closures += [team.false_closure(("alpha", int(i)), ("beta", int(j)), rng) for i, j in ends]
        unknown = [team.remeasured(c, covariance=np.eye(6)) for c in closures]
        steps = np.tile(np.eye(6), (59, 1, 1))
        odometry = {name: replace(t, step_covariances=steps) for name, t in team.odometry.items()}
        result = pairwise_consistent(unknown, odometry, PcmSettings(noise=EXACT, max_scale=10.0))
        kept.append(live(result))
    assert np.mean([of[:10] for of in kept]) >= 0.85
    assert not np.any([of[10:] for of in kept])


@pytest.mark.parametrize(("stated", "false"), [(1.0, 100), (0.25, 40)])
def test_false_loops_within_robots_are_told_from_sigmas_stated_too_small(stated, false):
    """Nodes in a cube with noisy rotations, false loops among them: under ten times the sigma most would agree."""
    rng, n = np.random.default_rng(6), 120
    sigma = np.repeat([0.05, 0.1], 3)
    truth = se3.from_rotation_translation(se3.exp(rng.normal(size=(n, 6)))[:, :3, :3], rng.uniform(0, 6, (n, 3)))
    steps = se3.between(truth[:-1], truth[1:]) @ se3.exp(rng.normal(size=(n - 1, 6)) * sigma)
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    covariance = np.diag((stated * sigma) ** 2)
    odometry = Trajectory(
        "a", np.arange(n) * 10**9, np.stack(poses), step_covariances=np.tile(covariance, (n - 1, 1, 1))
    )
    count = 100 + false
    first, second = rng.integers(0, 60, count), rng.integers(61, n, count)
    T = se3.between(truth[first], truth[second]) @ se3.exp(rng.normal(size=(count, 6)) * sigma)
    T[100:] = se3.exp(rng.normal(size=(false, 6)))
    closures = [
        Closure.from_measurement(KeyframeId("a", int(i)), KeyframeId("a", int(j)), T_ij, covariance)
        for i, j, T_ij in zip(first, second, T, strict=True)
    ]
    result = pairwise_consistent(closures, {"a": odometry}, PcmSettings(noise=EXACT, max_scale=10.0))
    assert result.scale == pytest.approx(1.0 / stated, rel=0.3)
    assert live(result)[:100].mean() > 0.97
    assert not live(result)[100:].any()


@pytest.mark.parametrize("seed", [0, 1])
def test_false_loops_within_robots_do_not_fit_under_a_metre_and_a_radian(team_maker, seed):
    """Edges that state nothing: false loops are as far off as such sigmas allow, and strain all else."""
    team, rng = team_maker(seed, noise=1.0), np.random.default_rng(seed)
    closures, false = between(team, "alpha", "beta", rng.integers(0, 60, (12, 2)), rng), []
    for robot in team.odometry:
        ends = np.stack([rng.integers(0, 25, 12), rng.integers(30, 60, 12)], axis=1).tolist()
        closures += [team.closure((robot, i), (robot, j), noise=rng) for i, j in ends[:8]]
        false += [team.false_closure((robot, i), (robot, j), rng) for i, j in ends[8:]]
    unknown = [team.remeasured(c, covariance=np.eye(6)) for c in closures + false]
    steps = np.tile(np.eye(6), (59, 1, 1))
    odometry = {name: replace(t, step_covariances=steps) for name, t in team.odometry.items()}
    kept = live(pairwise_consistent(unknown, odometry, PcmSettings(noise=EXACT, max_scale=10.0)))
    assert kept[: len(closures)].mean() >= 0.9
    assert not kept[len(closures) :].any()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_more_false_loops_than_true_within_robots_do_not_fit_where_closures_between_robots_tell(team_maker, seed):
    """Most own loops fit a metre and a radian better; all edges together are likelier with smaller errors."""
    team, rng = team_maker(seed, noise=1.0), np.random.default_rng(seed)
    true = between(team, "alpha", "beta", rng.integers(0, 60, (40, 2)), rng)
    false = []
    for robot in team.odometry:
        ends = np.stack([rng.integers(0, 25, 18), rng.integers(30, 60, 18)], axis=1).tolist()
        true += [team.closure((robot, i), (robot, j), noise=rng) for i, j in ends[:8]]
        false += [team.false_closure((robot, i), (robot, j), rng) for i, j in ends[8:]]
    unknown = [team.remeasured(c, covariance=np.eye(6)) for c in true + false]
    steps = np.tile(np.eye(6), (59, 1, 1))
    odometry = {name: replace(t, step_covariances=steps) for name, t in team.odometry.items()}
    kept = live(pairwise_consistent(unknown, odometry, PcmSettings(noise=EXACT, max_scale=10.0)))
    assert kept[: len(true)].mean() >= 0.9
    assert not kept[len(true) :].any()


@pytest.mark.parametrize(("seed", "sigma"), [(3, 1e-5), (0, 1e-3), (4, 1e-3), (0, 1e-2)])
def test_measurements_without_noise_written_with_six_digits_are_kept_whatever_they_state(seed, sigma):
    """The factor falls to where only rounding is left, no sign of false loops, and no further."""
    rng, n, odometry, paths = np.random.default_rng(seed), 100, {}, []

    def stated(count):
        sigmas = np.repeat([sigma, 5 * sigma], 3) * np.exp(rng.uniform(-1, 1, (count, 1)) * np.log(10.0))
        return np.stack([np.diag(of**2) for of in sigmas])

    def written(T):
        yaw = np.arctan2(T[:, 1, 0], T[:, 0, 0])
        return np.stack(
            [se3.from_yaw(round(float(y), 6), np.round(t, 6)) for y, t in zip(yaw, T[:, :3, 3], strict=True)]
        )

    for robot in ("alpha", "beta"):
        tangents = np.zeros((n - 1, 6))
        tangents[:, 2], tangents[:, 3] = rng.choice([0.0, np.pi / 2, -np.pi / 2, 0.0], n - 1), 1.0
        start = se3.from_yaw(rng.uniform(-3, 3), np.array([*rng.uniform(-5, 5, 2), 0.0]))
        truth = np.stack(list(accumulate(se3.exp(tangents), np.matmul, initial=start)))
        steps = written(se3.between(truth[:-1], truth[1:]))
        path = np.stack(list(accumulate(steps, np.matmul, initial=np.eye(4))))
        odometry[robot] = Trajectory(robot, np.arange(n) * 10**9, path, step_covariances=stated(n - 1))
        paths.append(truth)
    closures = []
    for a, b in ((0, 0), (0, 1), (1, 1)):
        i, j = rng.choice(n, 40, replace=False), rng.choice(n, 40, replace=False)
        i, j = (part[np.abs(i - j) > 3] for part in (i, j))
        T = written(se3.between(paths[a][i], paths[b][j]))
        ends = [
            (KeyframeId(list(odometry)[a], int(k)), KeyframeId(list(odometry)[b], int(m)))
            for k, m in zip(i, j, strict=True)
        ]
        measured = zip(ends, T, stated(len(i)), strict=True)
        closures += [Closure.from_measurement(*of, pose, covariance) for of, pose, covariance in measured]
    result = pairwise_consistent(closures, odometry, PcmSettings(noise=EXACT, max_scale=10.0))
    assert live(result).all()
    assert result.basis is not None
    assert (result.basis[1].factors >= 1e-3 * (1 - 1e-9)).all()


@pytest.mark.parametrize("seed", [0, 5])
def test_without_information_no_true_closure_is_lost(team_maker, seed):
    """The identity for all: odometry is better than closures, and rotations are known far better than a radian."""
    team, rng = team_maker(seed, ("alpha", "beta", "gamma"), noise=1.0), np.random.default_rng(seed)
    pairs = [(a, b) for a in team.odometry for b in team.odometry if a <= b]
    ends = [(a, b, int(i), int(j)) for a, b in pairs for i, j in rng.integers(0, 60, (40, 2))]
    closures = [team.closure((a, i), (b, j), noise=rng) for a, b, i, j in ends if a != b or abs(i - j) > 5]
    closures = [team.remeasured(c, covariance=np.eye(6)) for c in closures]
    odometry = {r: replace(t, step_covariances=np.tile(np.eye(6), (59, 1, 1))) for r, t in team.odometry.items()}
    found = pairwise_consistent(closures, odometry, PcmSettings(noise=EXACT, max_scale=10))
    assert live(found).all()
    assert 0.07 < found.scale < 0.13  # closures err by 0.1 m


@pytest.mark.parametrize("seed", [1, 3])
def test_sigmas_that_false_loops_within_robots_ask_for_are_taken_back_by_closures_between(team_maker, seed):
    names = ("alpha", "beta", "gamma", "delta")
    team, rng = team_maker(seed, names, n=100, noise=1.0), np.random.default_rng(seed)
    true = [c for a, b in combinations(names, 2) for c in between(team, a, b, rng.integers(0, 100, (40, 2)), rng)]
    false = []
    for robot in names:
        for i, j in rng.integers(0, 100, (28, 2)):
            if abs(i - j) > 20:
                T = se3.from_yaw(rng.uniform(-0.3, 0.3), rng.normal(0, [1.5, 1.5, 0.15]))
                false.append(team.remeasured(team.closure((robot, int(i)), (robot, int(j))), T_query_match=T))
    found = pairwise_consistent([*true, *false], team.odometry, PcmSettings(noise=EXACT, max_scale=10))
    assert live(found)[: len(true)].all()
    assert not live(found)[len(true) :].any()
    assert found.scale == 1
