from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.least_squares.edges import Edges, System, degrees_of_freedom

SIGMA = np.repeat([0.02, 0.1], 3)


def ring(seed, n=20):
    """Steps around a ring and chords across it, with noise; the true poses."""
    rng = np.random.default_rng(seed)
    angle = 2 * np.pi * np.arange(n) / n
    truth = se3.from_yaw(angle, np.stack([5 * np.sin(angle), -5 * np.cos(angle), 0 * angle], axis=1))
    ends = np.concatenate([np.stack([np.arange(n - 1), np.arange(1, n)], axis=1), [[0, n - 1], [2, n // 2]]])
    T = se3.between(truth[ends[:, 0]], truth[ends[:, 1]]) @ se3.exp(rng.normal(size=(len(ends), 6)) * SIGMA)
    return Edges(ends[:, 0], ends[:, 1], T, np.tile(np.diag(SIGMA**2), (len(ends), 1, 1))), truth


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_the_solution_is_gtsams(seed):
    edges, truth = ring(seed)
    found = System.of(edges, len(truth), np.array([0])).solved(truth)
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Diagonal.Sigmas(SIGMA)
    for i, j, T in zip(edges.first.tolist(), edges.second.tolist(), edges.T, strict=True):
        graph.add(gtsam.BetweenFactorPose3(i, j, gtsam.Pose3(T), noise))
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(truth[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)))
    for n, pose in enumerate(truth):
        values.insert(n, gtsam.Pose3(pose))
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-12)
    solved = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters).optimize()
    np.testing.assert_allclose(found, [solved.atPose3(n).matrix() for n in range(len(truth))], atol=2e-3)


def test_jacobians_are_those_of_small_motions():
    edges, truth = ring(1)
    system, rng = System.of(edges, len(truth), np.array([0])), np.random.default_rng(1)
    A, B = system.jacobians(truth)
    motion = 1e-6 * rng.normal(size=(len(truth), 6))
    change = system.residuals(truth @ se3.exp(motion)) - system.residuals(truth)
    linear = (A @ motion[edges.first][..., None] + B @ motion[edges.second][..., None])[..., 0]
    np.testing.assert_allclose(change, linear, atol=1e-3 * np.abs(linear).max())


def test_samples_of_the_estimate_have_the_marginal_covariance():
    edges, truth = ring(2)
    system, rng = System.of(edges, len(truth), np.array([0])), np.random.default_rng(2)
    ones = np.ones(len(edges))
    poses, moved = system.sampled(truth, ones, rng.normal(size=(len(edges), 6, 4000)))
    np.testing.assert_allclose(poses, system.solved(truth), atol=1e-5)  # converged to that
    H = np.linalg.inv(_normal_matrix(system, truth)[6:, 6:])
    for node in (5, 10, 19):
        block = slice(6 * (node - 1), 6 * node)
        sampled = moved[node] @ moved[node].T / moved.shape[2]
        np.testing.assert_allclose(np.diag(sampled), np.diag(H[block, block]), rtol=0.15)
    assert np.abs(moved[0]).max() < 1e-6


def _normal_matrix(system, poses):
    A, B = system.jacobians(poses)
    J = np.zeros((6 * len(A), 6 * len(poses)))
    for row, (i, j) in enumerate(zip(system.edges.first, system.edges.second, strict=True)):
        J[6 * row : 6 * row + 6, 6 * i : 6 * i + 6] = A[row]
        J[6 * row : 6 * row + 6, 6 * j : 6 * j + 6] = B[row]
    return J.T @ J


@pytest.mark.parametrize("weight", [0.0, 1.0])
def test_an_edge_of_no_weight_changes_nothing(weight):
    edges, truth = ring(3)
    false = Edges(np.array([3]), np.array([12]), se3.exp(np.full((1, 6), 0.8)), np.diag(SIGMA**2)[None])
    weights = np.append(np.ones(len(edges)), weight)
    found = System.of(edges + false, len(truth), np.array([0])).solved(truth, weights)
    without = System.of(edges, len(truth), np.array([0])).solved(truth)
    assert np.allclose(found, without, atol=1e-6) == (weight == 0.0)


def test_what_stays_in_the_plane_has_three_degrees_of_freedom():
    flat = se3.from_yaw(np.linspace(-3, 3, 5), np.array([[x, 2.0, 0.0] for x in range(5)]))
    assert degrees_of_freedom(flat, flat[:0]) == 3
    assert degrees_of_freedom(flat, flat @ se3.exp(np.array([0, 0.01, 0, 0, 0, 0]))) == 6
    assert degrees_of_freedom(flat @ se3.exp(np.array([0, 0, 0, 0, 0, 0.01]))) == 6
