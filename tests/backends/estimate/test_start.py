from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise
from wiclosure.backends.estimate.start import better_starts
from wiclosure.backends.least_squares.system import System
from wiclosure.backends.least_squares.team_arrays import TeamArrays

LIMIT = 16.8
STATED = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)


def prepared(team, count):
    """Arrays of a team with exact closures between alpha and beta."""
    rng = np.random.default_rng(0)
    closures = [team.closure(("alpha", int(i)), ("beta", int(j))) for i, j in rng.integers(0, 60, (count, 2))]
    sets, _ = closure_sets(closures, team.odometry, STATED)
    return TeamArrays.of(team.odometry, sets, np.zeros(len(closures), bool))


def true_poses(team):
    return {robot: t.poses for robot, t in team.truth.items()}


def starts_of(arrays, groups, rigid):
    robots = arrays.robots
    held = np.array([robots.first_nodes[arrays.names.index(group[0])] for group in groups])
    system = System.of(robots.odometry + robots.loops, arrays.stacked(rigid), held)
    return better_starts(arrays, system, groups, rigid, LIMIT)


def placed(team, drifted):
    """Odometry placed by the true pose of each robot's first keyframe."""
    return {robot: team.truth[robot].poses[0] @ t.poses for robot, t in drifted.items()}


def cost(arrays, poses):
    edges = arrays.robots.odometry + arrays.robots.loops
    return System.of(edges, poses, np.zeros(0, np.int64)).chi_squares(poses).sum()


def test_the_true_poses_stay(team_maker):
    team = team_maker(0)
    arrays = prepared(team, 6)
    start = starts_of(arrays, [("alpha", "beta")], true_poses(team))[0]
    np.testing.assert_allclose(start, arrays.stacked(true_poses(team)), atol=1e-6)


@pytest.mark.parametrize("first", ["alpha", "beta"])
def test_wrong_headings_are_found_from_the_closures(team_maker, first):
    """Odometry turned by two radians between robots: the closures alone tell, and the first robot does not move."""
    team = team_maker(1)
    arrays, rigid = prepared(team, 8), true_poses(team)
    other = "beta" if first == "alpha" else "alpha"
    rigid[other] = se3.from_yaw(2.0, np.array([40.0, 10.0, 0.0])) @ rigid[other]
    start = starts_of(arrays, [(first, other)], rigid)[0]
    np.testing.assert_allclose(start, arrays.stacked(true_poses(team)), atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_the_start_never_costs_more_than_rigid_odometry(team_maker, seed):
    team = team_maker(seed, noise=2.0)
    arrays, rigid = prepared(team, 10), placed(team, team.odometry)
    start = starts_of(arrays, [("alpha", "beta")], rigid)[0]
    assert cost(arrays, start) <= cost(arrays, arrays.stacked(rigid))
    root = arrays.robots.first_nodes[arrays.names.index("alpha")]
    np.testing.assert_allclose(start[root], rigid["alpha"][0], atol=1e-9)


def test_groups_start_by_themselves_and_those_without_closures_as_they_are(team_maker):
    team = team_maker(3, ("alpha", "beta", "gamma"))
    arrays, rigid = prepared(team, 8), true_poses(team)
    rigid["beta"] = se3.from_yaw(2.0, np.array([40.0, 10.0, 0.0])) @ rigid["beta"]
    rigid["gamma"] = se3.from_yaw(1.0, np.array([7.0, 0.0, 0.0])) @ rigid["gamma"]
    by_robot = arrays.poses_of(starts_of(arrays, [("alpha", "beta"), ("gamma",)], rigid)[0])
    np.testing.assert_array_equal(by_robot["gamma"], rigid["gamma"][arrays.nodes["gamma"]])
    np.testing.assert_allclose(by_robot["beta"], team.truth["beta"].poses[arrays.nodes["beta"]], atol=1e-5)


def test_false_closures_do_not_spoil_the_second_start(team_maker):
    """Odometry without drift, and three closures in four false: chordal initialisation costs less only in full."""
    team, rng = team_maker(4), np.random.default_rng(4)
    ends = rng.integers(0, 60, (40, 2)).tolist()
    closures = [team.closure(("alpha", i), ("beta", j)) for i, j in ends[:10]]
    closures += [team.false_closure(("alpha", i), ("beta", j), rng) for i, j in ends[10:]]
    sets, _ = closure_sets(closures, team.odometry, STATED)
    arrays = TeamArrays.of(team.odometry, sets, np.zeros(len(closures), bool))
    in_full, truncated = starts_of(arrays, [("alpha", "beta")], true_poses(team))
    assert cost(arrays, in_full) < cost(arrays, truncated)
    np.testing.assert_allclose(truncated, arrays.stacked(true_poses(team)), atol=1e-6)
