from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise
from wiclosure.backends.least_squares.team_arrays import TeamArrays, covariance_parts_between
from wiclosure.backends.least_squares.variance_components import restated, summed

STATED = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
ROBOTS = ("alpha", "beta", "gamma")


def arrays(team, ends, predicted=None):
    """Of exact closures between the given ends."""
    closures = [team.closure((a, int(i)), (b, int(j))) for a, i, b, j in ends]
    sets, _ = closure_sets(closures, team.odometry, STATED)
    return TeamArrays.of(team.odometry, sets, np.zeros(len(ends), bool) if predicted is None else predicted)


def true_nodes(team, found):
    return found.stacked({robot: t.poses for robot, t in team.truth.items()})


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_all_edges_join_the_nodes_that_they_measure(team_maker, seed):
    """Without noise, every edge is met exactly by the true poses of its nodes."""
    team, rng = team_maker(seed, ROBOTS), np.random.default_rng(seed)
    pairs = rng.integers(0, 60, (9, 2))
    ends = [(ROBOTS[n % 3], i, ROBOTS[(n + n // 3) % 3], j) for n, (i, j) in enumerate(pairs) if i != j]
    found = arrays(team, ends)
    truth = true_nodes(team, found)
    for edges in (found.robots.odometry, found.robots.loops):
        np.testing.assert_allclose(edges.errors(truth), 0.0, atol=1e-6)
    assert len(found.robots.odometry) == len(truth) - 3


def test_nodes_are_the_ends_of_closures_and_each_robots_first(team_maker):
    found = arrays(team_maker(0, ROBOTS), [("alpha", 7, "beta", 20), ("alpha", 7, "alpha", 50)])
    assert {robot: nodes.tolist() for robot, nodes in found.nodes.items()} == {
        "alpha": [0, 7, 50],
        "beta": [0, 20],
        "gamma": [0],
    }
    sizes = [len(found.nodes[name]) for name in found.names]
    assert found.robots.robot.tolist() == np.repeat(np.arange(3), sizes).tolist()
    assert found.robots.first_nodes.tolist() == [0, sizes[0], sizes[0] + sizes[1]]


def test_rows_and_predictions_are_of_the_list_that_closures_came_from(team_maker):
    team = team_maker(1, ROBOTS)
    ends = [("alpha", 3, "beta", 4), ("beta", 5, "gamma", 6), ("alpha", 8, "beta", 9), ("alpha", 1, "alpha", 30)]
    found = arrays(team, ends, np.array([False, True, False, True]))
    assert sorted(found.rows.tolist()) == [0, 1, 2, 3]
    assert sorted(found.rows[found.robots.predicted].tolist()) == [1, 3]
    assert found.rows[found.robots.own].tolist() == [3]


def test_far_from_the_origin_no_digits_are_lost(team_maker):
    team, ends = team_maker(2), [("alpha", 3, "beta", 4), ("alpha", 40, "beta", 50)]
    near = arrays(team, ends)
    utm = se3.from_yaw(0.3, np.array([4.5e5, 5.4e6, 300.0]))
    team.odometry.update({robot: t.moved(utm) for robot, t in team.odometry.items()})
    np.testing.assert_allclose(arrays(team, ends).robots.poses, near.robots.poses, atol=1e-6)


def test_poses_go_back_to_their_robots(team_maker):
    team = team_maker(3, ROBOTS)
    found = arrays(team, [("alpha", 7, "beta", 20), ("beta", 9, "gamma", 33)])
    by_robot = found.poses_of(true_nodes(team, found))
    assert set(by_robot) == set(ROBOTS)
    for robot, poses in by_robot.items():
        np.testing.assert_array_equal(poses, team.truth[robot].poses[found.nodes[robot]])


@pytest.mark.parametrize("step_m", [0.5, 2.0])
def test_the_step_is_the_distance_between_keyframes_and_not_between_nodes(team_maker, step_m):
    found = arrays(team_maker(4, step_m=step_m), [("alpha", 10, "beta", 50)])
    assert found.robots.step_m == pytest.approx(step_m, rel=0.05)


def test_separate_factors_hold_for_what_is_stated_however_it_is_turned_or_chained(team_maker):
    team, factors = team_maker(3, noise=1.0), np.array([0.1, 4.0])
    closures = [team.closure(("alpha", 3 * n), ("beta", 50 - 2 * n)) for n in range(10)]
    closures += [team.closure(("beta", 40 - n), ("alpha", n)) for n in range(5)]
    closures += [team.closure(("beta", 30 + n), ("beta", n)) for n in range(5)]
    stated = np.tile(np.eye(6), (59, 1, 1))

    def arrays(times):
        covariance, floor = restated(np.eye(6), times), ClosureNoise(translation_m=1e-9, rotation_rad=1e-9)
        of_times = [team.remeasured(c, covariance=covariance) for c in closures]
        odometry = {r: replace(t, step_covariances=restated(stated, times)) for r, t in team.odometry.items()}
        sets, _ = closure_sets(of_times, odometry, floor)
        return TeamArrays.of(odometry, sets, np.zeros(len(closures), bool)).robots

    found, expected = arrays(1.0).scaled(factors), arrays(factors)
    for one, other in ((found.odometry, expected.odometry), (found.loops, expected.loops)):
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("times", [1.0, np.array([0.1, 4.0])])
def test_parts_of_what_is_chained_sum_up_to_what_other_steps_would_state(team_maker, times):
    alpha = replace(team_maker(3, noise=1.0).odometry["alpha"], step_covariances=np.tile(np.eye(6), (59, 1, 1)))
    first, second = np.array([0, 10, 58]), np.array([20, 10, 59])
    found = summed(covariance_parts_between(alpha, first, second), times)
    restated_steps = replace(alpha, step_covariances=restated(alpha.step_covariances, times))
    np.testing.assert_allclose(found, restated_steps.relative_covariance(first, second), rtol=1e-6, atol=1e-8)
