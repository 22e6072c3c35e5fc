from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.estimate.graph_result import GraphResult, propagate_to_scans
from wiclosure.backends.factor_graph.factors import Keys
from wiclosure.errors import InputError
from wiclosure.types import Closure, KeyframeId, Stage, Trajectory

SECOND = 10**9


def chain(robot, n, T_first):
    steps = se3.exp(np.tile([0.0, 0.0, 0.2, 1.0, 0.0, 0.0], (n - 1, 1)))
    poses = [T_first]
    for step in steps:
        poses.append(poses[-1] @ step)
    return Trajectory(robot, np.arange(n) * SECOND, np.stack(poses))


def result(components=(("alpha", "beta"), ("gamma",)), sigma_scale=1.0, closures=()):
    """Three robots of five keyframes; a chain of factors along each, and one between alpha and beta."""
    trajectories = {
        robot: chain(robot, 5, se3.from_yaw(float(n), np.array([3.0 * n, 0.0, 0.0])))
        for n, robot in enumerate(("alpha", "beta", "gamma"))
    }
    keys, graph, values = Keys(tuple(trajectories)), gtsam.NonlinearFactorGraph(), gtsam.Values()
    step = gtsam.noiseModel.Diagonal.Sigmas(np.repeat([0.01, 0.1], 3))

    def join(one, other):
        T = se3.between(*(trajectories[robot].poses[index] for robot, index in (one, other)))
        graph.add(gtsam.BetweenFactorPose3(keys(*one), keys(*other), gtsam.Pose3(T), step))

    for robot, trajectory in trajectories.items():
        for n, T in enumerate(trajectory.poses):
            values.insert(keys(robot, n), gtsam.Pose3(T))
            if n:
                join((robot, n - 1), (robot, n))
    join(("alpha", 2), ("beta", 2))
    for robot in ("alpha", "gamma"):
        held = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)
        graph.add(gtsam.PriorFactorPose3(keys(robot, 0), gtsam.Pose3(trajectories[robot].poses[0]), held))
    return GraphResult(trajectories, {}, components, tuple(closures), (), graph, values, sigma_scale)


def closure(of, a, b, error=0.0):
    T = se3.between(of.trajectories[a[0]].poses[a[1]], of.trajectories[b[0]].poses[b[1]])
    T = T @ se3.from_yaw(0.0, np.array([error, 0.0, 0.0]))
    return Closure.from_measurement(KeyframeId(*a), KeyframeId(*b), T, np.eye(6))


def test_residuals_are_what_was_put_in_and_unknown_between_robots_that_nothing_connects():
    found = result()
    closures = [
        closure(found, ("alpha", 1), ("beta", 3), 2.5),
        closure(found, ("alpha", 1), ("gamma", 3)),
        closure(found, ("beta", 0), ("beta", 4)),
    ]
    residuals = found.residuals(closures)
    np.testing.assert_allclose(residuals[0], [0, 0, 0, -2.5, 0, 0], atol=1e-9)
    assert np.isnan(residuals[1]).all()
    np.testing.assert_allclose(residuals[2], 0.0, atol=1e-9)
    assert found.residuals([]).shape == (0, 6)


def test_accepted_closures_and_robots_apart():
    plain = result()
    kept = closure(plain, ("alpha", 1), ("beta", 3)).accepted(Stage.ESTIMATE)
    lost = closure(plain, ("alpha", 2), ("beta", 3)).rejected(Stage.ESTIMATE, "far off")
    found = result(closures=[kept, lost])
    assert found.accepted == (kept,)
    assert found.unconnected == ("gamma",)
    assert repr(found) == "GraphResult(alpha and beta; gamma; 1 of 2 closures accepted)"


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_the_covariance_between_keyframes_is_that_of_the_steps_between_them(scale):
    found = result(sigma_scale=scale)
    step = np.diag(np.square(np.repeat([0.01, 0.1], 3)))
    one = found.relative_covariance(KeyframeId("alpha", 1), KeyframeId("alpha", 2))
    np.testing.assert_allclose(one, scale**2 * step, rtol=1e-6, atol=1e-12)
    across = found.relative_covariance(KeyframeId("alpha", 1), KeyframeId("beta", 2))
    T = found.trajectories
    expected = se3.compose_covariance(step, se3.between(T["alpha"].poses[2], T["beta"].poses[2]), step)
    np.testing.assert_allclose(across, scale**2 * expected, rtol=1e-6, atol=1e-12)
    assert (found.relative_covariance(KeyframeId("beta", 1), KeyframeId("beta", 1)) == 0).all()
    anchored = found.covariances("alpha", [0, 1])
    np.testing.assert_allclose(anchored[1], scale**2 * step, rtol=1e-3, atol=1e-9)
    with pytest.raises(InputError, match="nothing connects alpha to gamma: their relative pose is unknown"):
        found.relative_covariance(KeyframeId("alpha", 1), KeyframeId("gamma", 1))


@given(seed=st.integers(0, 2**32 - 1))
def test_scans_keep_their_odometry_and_move_between_keyframes_where_these_disagree(seed):
    rng = np.random.default_rng(seed)
    odometry = se3.exp(np.cumsum(rng.normal(size=(21, 6)) * [0.02, 0.02, 0.1, 0.3, 0.1, 0.05], axis=0) * 0.1)
    scans = Trajectory("alpha", np.arange(21) * SECOND, odometry)
    every = np.arange(0, 21, 5)
    keyframes = scans.keyframes(every)
    T = se3.exp(rng.normal(size=6))
    moved = propagate_to_scans(scans, keyframes, keyframes.moved(T))
    np.testing.assert_allclose(moved.poses, T @ odometry, atol=1e-9)
    bent = Trajectory("alpha", keyframes.stamps_ns, keyframes.poses @ se3.exp(rng.normal(size=(5, 6)) * 0.02))
    found = propagate_to_scans(scans, keyframes, bent)
    np.testing.assert_allclose(found.poses[every], bent.poses, atol=1e-9)
    step = np.abs(
        se3.log(se3.between(se3.between(odometry[:-1], odometry[1:]), se3.between(found.poses[:-1], found.poses[1:])))
    )
    assert step.max() < 0.05  # no jump between one keyframe and the next


def test_scans_beyond_the_keyframes_keep_their_odometry_to_the_nearest():
    poses = se3.from_yaw(np.zeros(6), np.column_stack([np.arange(6.0), np.zeros((6, 2))]))
    scans = Trajectory("alpha", np.arange(6) * SECOND, poses)
    keyframes = scans.keyframes(np.array([2, 3]))
    shifted = keyframes.moved(se3.from_yaw(0.0, np.array([0.0, 7.0, 0.0])))
    found = propagate_to_scans(scans, keyframes, shifted)
    np.testing.assert_allclose(found.positions, scans.positions + np.array([0.0, 7.0, 0.0]), atol=1e-12)
