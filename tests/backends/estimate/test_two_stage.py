from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise, PoseGraphSettings
from wiclosure.backends.estimate.two_stage import placed_in_two_stages
from wiclosure.types import EarthMeasurements

STATED = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
GNC = PoseGraphSettings(optimiser="two-stage")
ROBOTS = ("alpha", "beta", "gamma")


def closures(team, a, b, count, seed=0):
    rng = np.random.default_rng(seed)
    return [team.closure((a, int(i)), (b, int(j))) for i, j in rng.integers(0, 60, (count, 2))]


def placed(team, found, settings=GNC):
    """Which closures are inliers, in the order given, and the frames."""
    sets, _ = closure_sets(found, team.odometry, STATED)
    masks, frames = placed_in_two_stages(team.odometry, sets, settings, EarthMeasurements())
    inlier = np.zeros(len(found), bool)
    for closure_set, mask in zip(sets, masks, strict=True):
        inlier[closure_set.rows] = mask
    return inlier, frames


def assert_true(team, frames, robots, atol=1e-5):
    for robot in robots:
        expected = se3.between(team.T_world_odom[robots[0]], team.T_world_odom[robot])
        np.testing.assert_allclose(se3.between(frames[robots[0]], frames[robot]), expected, atol=atol)


@pytest.mark.parametrize("robust", ["gnc", "cauchy", "none"])
def test_exact_closures_give_the_frames_back(team_maker, robust):
    team = team_maker(0, ROBOTS)
    found = closures(team, "alpha", "beta", 4) + closures(team, "gamma", "beta", 4)
    inlier, frames = placed(team, found, PoseGraphSettings(optimiser="two-stage", robust=robust))
    assert inlier.all()
    np.testing.assert_allclose(frames["alpha"], np.eye(4), atol=1e-6)
    assert_true(team, frames, ROBOTS)


def test_false_closures_are_switched_off_and_move_nothing(team_maker):
    team, rng = team_maker(1), np.random.default_rng(1)
    false = [team.false_closure(("alpha", int(i)), ("beta", int(j)), rng) for i, j in rng.integers(0, 60, (4, 2))]
    inlier, frames = placed(team, closures(team, "alpha", "beta", 8) + false)
    assert inlier.tolist() == [True] * 8 + [False] * 4
    assert_true(team, frames, ("alpha", "beta"), 1e-2)  # a tenth of a closure's sigma: the last step may be a small one


def test_closures_within_one_robot_are_kept_and_change_nothing(team_maker):
    team, rng = team_maker(2), np.random.default_rng(2)
    between = closures(team, "alpha", "beta", 5)
    false = team.false_closure(("alpha", 3), ("alpha", 50), rng)
    (_, without), (inlier, frames) = placed(team, between), placed(team, [*between, false])
    assert inlier.all()
    for robot in team.odometry:
        np.testing.assert_array_equal(frames[robot], without[robot])


def test_robots_that_nothing_joins_stay_in_their_own_frame(team_maker):
    team = team_maker(3, ROBOTS)
    _, frames = placed(team, closures(team, "alpha", "beta", 4))
    assert_true(team, frames, ("alpha", "beta"))
    np.testing.assert_allclose(frames["gamma"], np.eye(4), atol=1e-9)


def test_every_pair_counts_the_same_however_many_its_closures(team_maker):
    """Three pairs that do not close by 0.3 m: each takes a third of it, the one of 20 closures as those of 2."""
    team = team_maker(4, ROBOTS)
    shift = se3.from_yaw(0.0, np.array([0.3, 0.0, 0.0]))
    off = []
    for c in closures(team, "alpha", "gamma", 20):
        T_alpha, T_gamma = (team.odometry[k.robot].poses[k.index] for k in (c.query, c.match))
        T_true = se3.between(team.T_world_odom["alpha"], team.T_world_odom["gamma"])
        off.append(team.remeasured(c, T_query_match=se3.between(T_alpha, shift @ T_true @ T_gamma)))
    found = closures(team, "alpha", "beta", 2) + closures(team, "beta", "gamma", 2) + off
    inlier, frames = placed(team, found)
    assert inlier.all()
    T_true = se3.between(team.T_world_odom["alpha"], team.T_world_odom["gamma"])
    residual = np.linalg.norm((shift @ T_true)[:3, 3] - frames["gamma"][:3, 3])
    assert 0.05 < residual < 0.15
