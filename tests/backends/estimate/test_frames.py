from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise
from wiclosure.backends.estimate.frames import components, frame_estimates, frame_transform, initial_frames
from wiclosure.types import RadioLinks

STATED = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)


def sets_of(team, ends, false=(), seed=0):
    """Exact closures between robots, and false ones."""
    rng = np.random.default_rng(seed)
    closures = [team.closure((a, i), (b, j)) for a, i, b, j in ends]
    closures += [team.false_closure((a, i), (b, j), rng) for a, i, b, j in false]
    sets, unusable = closure_sets(closures, team.odometry, STATED)
    assert not unusable
    return sets


def links(a, b, T_a_b, n=3):
    zeros = np.zeros((n, 3))
    index = np.arange(n)
    return RadioLinks(
        a, b, T_a_b, np.eye(6), index, index, zeros, zeros, np.ones(n, bool), np.ones(n), np.ones(n), zeros,
        np.zeros((n, 3, 3)),
    )  # fmt: skip


def true_frame(team, a, b):
    return se3.between(team.T_world_odom[a], team.T_world_odom[b])


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_exact_closures_give_the_frames_back(team_maker, seed):
    team = team_maker(seed, ("alpha", "beta", "gamma"))
    rng = np.random.default_rng(seed)
    ends = [("alpha", i, "beta", j) for i, j in rng.integers(0, 60, (4, 2))]
    ends += [("gamma", i, "beta", j) for i, j in rng.integers(0, 60, (3, 2))]
    sets = sets_of(team, ends)
    frames = initial_frames(team.odometry, sets)
    for robot in team.odometry:
        np.testing.assert_allclose(frames[robot], true_frame(team, "alpha", robot), atol=1e-6)
    for closure_set in sets:
        expected = true_frame(team, closure_set.robot_a, closure_set.robot_b)
        np.testing.assert_allclose(
            frame_estimates(closure_set, team.odometry), np.tile(expected, (len(closure_set), 1, 1)), atol=1e-6
        )


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6))
def test_three_in_four_false_closures_do_not_move_a_frame(team_maker, seed):
    team = team_maker(seed)
    rng = np.random.default_rng(seed)
    true, false = ([("alpha", i, "beta", j) for i, j in rng.integers(0, 60, (n, 2))] for n in (6, 18))
    (closure_set,) = sets_of(team, true, false, seed)
    expected = true_frame(team, closure_set.robot_a, closure_set.robot_b)
    np.testing.assert_allclose(frame_transform(closure_set, team.odometry), expected, atol=1e-6)


def test_the_best_supported_pairs_decide_where_there_is_a_choice(team_maker):
    team = team_maker(3, ("alpha", "beta", "gamma"))
    strong = [("alpha", k, "beta", k) for k in range(5)] + [("beta", k, "gamma", k) for k in range(5)]
    frames = initial_frames(team.odometry, sets_of(team, strong, [("alpha", 4, "gamma", 50)]))
    np.testing.assert_allclose(frames["gamma"], true_frame(team, "alpha", "gamma"), atol=1e-6)


def test_groups_are_in_the_order_of_the_robots(team_maker):
    robots = ("delta", "alpha", "gamma", "beta")
    team = team_maker(1, robots)
    sets = sets_of(team, [("beta", 3, "delta", 4)])
    assert components(robots, sets) == (("delta", "beta"), ("alpha",), ("gamma",))
    assert components(robots, [], [links("gamma", "alpha", np.eye(4))]) == (("delta",), ("alpha", "gamma"), ("beta",))


def test_radio_places_robots_that_no_closure_does_and_no_others(team_maker):
    team = team_maker(2, ("alpha", "beta", "gamma"))
    T = se3.from_yaw(0.7, np.array([5.0, 1.0, 0.0]))
    sets = sets_of(team, [("alpha", 3, "beta", 4)])
    frames = initial_frames(team.odometry, sets, [links("beta", "gamma", T), links("alpha", "beta", np.eye(4))])
    np.testing.assert_allclose(frames["beta"], true_frame(team, "alpha", "beta"), atol=1e-6)
    np.testing.assert_allclose(frames["gamma"], frames["beta"] @ T, atol=1e-6)


def test_every_group_has_a_world_of_its_own(team_maker):
    team = team_maker(4)
    frames = initial_frames(team.odometry, [])
    for robot in team.odometry:
        np.testing.assert_array_equal(frames[robot], np.eye(4))
    assert list(frames) == ["alpha", "beta"]
