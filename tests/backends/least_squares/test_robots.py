from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.least_squares.edges import Edges
from wiclosure.backends.least_squares.robots import Robots


def edges(ends):
    first, second = np.array(ends).T
    T = np.tile(se3.from_yaw(0.1, np.array([1.0, 0.0, 0.0])), (len(ends), 1, 1))
    return Edges(first, second, T, np.tile(np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]), (len(ends), 1, 1)))


@pytest.fixture
def robots():
    """Three robots of 2, 3 and 1 nodes; the second has a loop of its own."""
    loops = edges([(0, 2), (4, 2), (5, 1)])
    robot, poses = np.array([0, 0, 1, 1, 1, 2]), np.tile(np.eye(4), (6, 1, 1))
    along_m, length_m = np.array([0.0, 1.0, 0.0, 1.0, 2.0, 0.0]), np.array([1.0, 2.0, 0.0])
    return Robots(robot, poses, edges([(0, 1), (2, 3), (3, 4)]), loops, np.zeros(3, bool), along_m, length_m, 1.0)


def test_robots_are_counted_and_their_first_nodes_found(robots):
    assert robots.count == 3
    assert robots.first_nodes.tolist() == [0, 2, 5]


def test_closures_within_one_robot_are_its_own(robots):
    assert robots.own.tolist() == [False, True, False]


def test_ends_are_in_the_groups_of_their_robots(robots):
    first, second = robots.groups_of_ends(np.array([0, 1, 0]))
    assert first.tolist() == [0, 1, 0]
    assert second.tolist() == [1, 1, 0]


def test_a_scale_of_sigma_is_squared_in_covariances_and_changes_nothing_else(robots):
    scaled = robots.scaled(3.0)
    for part, before in ((scaled.odometry, robots.odometry), (scaled.loops, robots.loops)):
        np.testing.assert_array_equal(part.covariance, 9.0 * before.covariance)
        np.testing.assert_array_equal(part.T, before.T)
        np.testing.assert_array_equal(part.first, before.first)
        np.testing.assert_array_equal(part.second, before.second)
    np.testing.assert_array_equal(scaled.poses, robots.poses)
    assert robots.loops.covariance[0, 0, 0] == 1.0


def test_a_scale_below_one_leaves_in_what_written_digits_lose(robots):
    """A tenth hardly differs; a billionth leaves the last of six decimals, or of six digits of a length."""
    tenth, none = robots.scaled(0.1), robots.scaled(1e-9)
    np.testing.assert_allclose(tenth.loops.covariance, 0.01 * robots.loops.covariance, rtol=1e-8, atol=1e-11)
    written = np.diag(np.repeat([1e-6**2, 1e-6**2 + 3e-6**2], 3))
    np.testing.assert_allclose(none.odometry.covariance[0], written, rtol=1e-4, atol=1e-20)


def test_drift_is_shared_by_the_extent_of_paths_that_close_loops(robots):
    """Two steps of 5 m each axis, on a path that reaches 20 m; the other robots have no loops of their own."""
    poses = robots.poses.copy()
    poses[2:5, 0, 3] = [0.0, 20.0, 10.0]
    assert replace(robots, poses=poses).drift_share() == pytest.approx(np.sqrt(2 * 5.0) / 20.0)
    assert replace(robots, loops=edges([(0, 2)])).drift_share() == 0.0


def test_a_robot_that_is_cut_is_two_and_the_step_between_is_left_out(robots):
    cut = robots.cut(3)
    assert cut.robot.tolist() == [0, 0, 1, 2, 2, 3]
    assert cut.odometry.first.tolist() == [0, 3]
    assert cut.length_m.tolist() == [1.0, 0.0, 1.0, 0.0]
    assert cut.own.tolist() == [False, False, False]
    assert robots.steps_across(3).tolist() == [False, True, False]
