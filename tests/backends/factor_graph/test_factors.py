from __future__ import annotations

import gtsam
import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise, PoseGraphSettings
from wiclosure.backends.factor_graph.factors import (
    Keys,
    anchor,
    closure_factors,
    inliers_among,
    keyframes_in_factors,
    least_squares,
    odometry_factors,
    prior,
    with_factors,
)

STATED = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
KEYS = Keys(("alpha", "beta"))


def sets_of(team, closures):
    return closure_sets(closures, team.odometry, STATED)[0]


def values_at(team, poses):
    """Values of all keyframes at the poses by robot."""
    values = gtsam.Values()
    for robot in team.odometry:
        for n, T in enumerate(poses[robot]):
            values.insert(KEYS(robot, n), gtsam.Pose3(T))
    return values


def true_values(team):
    return values_at(team, {robot: t.poses for robot, t in team.truth.items()})


def measurements(rng, n, wrong):
    """Factors that measure one pose `n` times, those of the rows `wrong` five metres off."""
    covariance = np.diag(np.repeat([0.01**2, 0.1**2], 3))
    T = np.tile(np.eye(4), (n, 1, 1))
    T[wrong] = se3.from_yaw(0.5, np.array([5.0, 0.0, 0.0]))
    T = T @ se3.exp(rng.multivariate_normal(np.zeros(6), covariance, n))
    return [prior(0, of, covariance) for of in T]


def test_keys_are_gtsams_symbols():
    assert KEYS("alpha", 3) == gtsam.symbol("a", 3)
    assert KEYS.all("beta", np.array([0, 7])) == [gtsam.symbol("b", 0), gtsam.symbol("b", 7)]
    assert Keys.same_robot(KEYS("alpha", 3), KEYS("alpha", 900))
    assert not Keys.same_robot(KEYS("alpha", 3), KEYS("beta", 3))


def test_keyframes_in_factors_are_the_ends_of_closures_and_the_first(team_maker):
    team = team_maker(0)
    sets = sets_of(team, [team.closure(("alpha", 9), ("beta", 4)), team.closure(("alpha", 2), ("alpha", 9))])
    found = keyframes_in_factors(team.odometry, sets)
    assert {robot: nodes.tolist() for robot, nodes in found.items()} == {"alpha": [0, 2, 9], "beta": [0, 4]}


@pytest.mark.parametrize("seed", range(3))
def test_the_true_poses_meet_every_factor(team_maker, seed):
    team, rng = team_maker(seed, n=30), np.random.default_rng(seed)
    sets = sets_of(team, [team.closure(("alpha", int(i)), ("beta", int(j))) for i, j in rng.integers(0, 30, (5, 2))])
    nodes = keyframes_in_factors(team.odometry, sets)
    everything, few = (odometry_factors(team.odometry, sets, KEYS, of) for of in (None, nodes))
    assert everything.size() == 2 * 29
    assert few.size() == sum(len(of) - 1 for of in nodes.values())
    closures = closure_factors(sets, KEYS)
    assert len(closures) == 5
    for graph in (everything, few, with_factors(gtsam.NonlinearFactorGraph(), closures)):
        assert graph.error(true_values(team)) == pytest.approx(0.0, abs=1e-6)


def test_the_error_of_a_closure_is_half_its_squared_distance(team_maker):
    """Off by two sigma along one axis: half of four."""
    team = team_maker(1, n=10)
    error = np.array([0.0, 0.0, 0.0, 0.2, 0.0, 0.0])
    (factor,) = closure_factors(sets_of(team, [team.closure(("alpha", 3), ("beta", 4), error=error)]), KEYS)
    assert factor.error(true_values(team)) == pytest.approx(2.0, rel=1e-3)


def test_the_given_graph_does_not_grow(team_maker):
    team = team_maker(2, n=10)
    graph = odometry_factors(team.odometry, [], KEYS)
    grown = with_factors(graph, [anchor(KEYS("alpha", 0), gtsam.Pose3())])
    assert (graph.size(), grown.size()) == (18, 19)


def test_a_loose_anchor_pulls_a_thousandth_of_what_a_firm_one_does():
    values = gtsam.Values()
    values.insert(0, gtsam.Pose3(se3.exp(np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0]))))
    firm, loose = (anchor(0, gtsam.Pose3(), loose=way).error(values) for way in (False, True))
    assert firm == pytest.approx(0.5 * 1e8)
    assert loose < 1e-3


def test_least_squares_of_two_measurements_is_their_weighted_mean():
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    graph.add(prior(0, np.eye(4), np.eye(6)))
    graph.add(prior(0, se3.from_yaw(0.0, np.array([4.0, 0.0, 0.0])), 3.0 * np.eye(6)))
    values.insert(0, gtsam.Pose3())
    np.testing.assert_allclose(least_squares(graph, values).atPose3(0).translation(), [1.0, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("robust", ["gnc", "cauchy"])
def test_robust_ways_find_the_outliers_and_the_pose_of_the_others(robust):
    wrong = [1, 4, 7]
    nothing, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    nothing.add(anchor(0, gtsam.Pose3(), loose=True))
    values.insert(0, gtsam.Pose3(se3.from_yaw(0.1, np.array([1.0, 1.0, 0.0]))))
    factors = measurements(np.random.default_rng(0), 12, wrong)
    inlier, estimate = inliers_among(factors, nothing, values, PoseGraphSettings(robust=robust))
    assert np.flatnonzero(~inlier).tolist() == wrong
    np.testing.assert_allclose(estimate.atPose3(0).translation(), 0.0, atol=0.2)


def test_without_a_robust_way_every_measurement_counts_in_full():
    nothing, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    values.insert(0, gtsam.Pose3())
    wide = 1e-2 * np.eye(6)
    factors = [prior(0, se3.from_yaw(0.0, np.array([x, 0.0, 0.0])), wide) for x in (0.0, 0.0, 9.0)]
    inlier, estimate = inliers_among(factors, nothing, values, PoseGraphSettings(robust="none"))
    assert inlier.tolist() == [True] * 3
    np.testing.assert_allclose(estimate.atPose3(0).translation(), [3.0, 0.0, 0.0], atol=1e-6)


def test_without_measurements_what_is_known_decides():
    known, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    known.add(anchor(0, gtsam.Pose3()))
    values.insert(0, gtsam.Pose3(se3.from_yaw(0.5, np.array([2.0, 0.0, 0.0]))))
    inlier, estimate = inliers_among([], known, values, PoseGraphSettings())
    assert len(inlier) == 0
    np.testing.assert_allclose(estimate.atPose3(0).matrix(), np.eye(4), atol=1e-6)
