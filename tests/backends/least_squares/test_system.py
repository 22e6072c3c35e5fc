from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.least_squares.edges import Edges
from wiclosure.backends.least_squares.system import System

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
    found = System.of(edges, truth, np.array([0])).solved(truth)
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
    system, rng = System.of(edges, truth, np.array([0])), np.random.default_rng(1)
    A, B = system.jacobians(truth)
    motion = 1e-6 * rng.normal(size=(len(truth), 6))
    change = system.residuals(truth @ se3.exp(motion)) - system.residuals(truth)
    linear = (A @ motion[edges.first][..., None] + B @ motion[edges.second][..., None])[..., 0]
    np.testing.assert_allclose(change, linear, atol=1e-3 * np.abs(linear).max())


def test_samples_of_the_estimate_have_the_marginal_covariance():
    edges, truth = ring(2)
    system, rng = System.of(edges, truth, np.array([0])), np.random.default_rng(2)
    descent = system.descent(truth, np.ones(len(edges)))
    assert descent.converged
    moved = system.spread(descent, rng.normal(size=(len(edges), 6, 4000)))
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
    found = System.of(edges + false, truth, np.array([0])).solved(truth, weights)
    without = System.of(edges, truth, np.array([0])).solved(truth)
    assert np.allclose(found, without, atol=1e-6) == (weight == 0.0)


def planar_ring(seed):
    """The same ring, with noise in the plane alone."""
    edges, truth = ring(seed)
    T = se3.between(truth[edges.first], truth[edges.second])
    noise = np.random.default_rng(seed).normal(size=(len(edges), 6)) * SIGMA * [0, 0, 1, 1, 1, 0]
    return Edges(edges.first, edges.second, T @ se3.exp(noise), edges.covariance), truth


def test_in_the_plane_three_degrees_of_freedom_give_what_six_do():
    edges, truth = planar_ring(4)
    tilted = Edges(edges.first, edges.second, edges.T, edges.covariance.copy())
    tilted.covariance[0, 0, 2] = tilted.covariance[0, 2, 0] = 1e-9  # no longer independent: all six
    flat, full = (System.of(e, truth, np.array([0])) for e in (edges, tilted))
    assert (len(flat.free), len(full.free)) == (3, 6)
    np.testing.assert_allclose(flat.solved(truth), full.solved(truth), atol=1e-5)
    rng = np.random.default_rng(4)
    ones = np.ones(len(edges))
    samples = [s.spread(s.descent(truth, ones), rng.normal(size=(len(edges), len(s.free), 4000))) for s in (flat, full)]
    of_flat, of_full = (moved[10] @ moved[10].T / 4000 for moved in samples)
    assert samples[0].shape == samples[1].shape
    np.testing.assert_allclose(np.diag(of_flat)[2:5], np.diag(of_full)[2:5], rtol=0.15)
    assert not of_flat[[0, 1, 5]].any()


def chain_with_loop(noise: float) -> tuple[Edges, np.ndarray]:
    """A square of eight poses, a loop from the last to the first, and the true poses."""
    rng = np.random.default_rng(3)
    steps = se3.exp(np.tile([0.0, 0.0, np.pi / 4, 1.0, 0.0, 0.0], (8, 1)))
    truth = [np.eye(4)]
    for step in steps[:-1]:
        truth.append(truth[-1] @ step)
    first, second = np.arange(8), (np.arange(8) + 1) % 8
    T = se3.between(np.stack(truth)[first], np.stack(truth)[second])
    covariance = np.tile(np.diag(np.repeat([0.01, 0.1], 3) ** 2), (8, 1, 1))
    return Edges(first, second, T @ se3.exp(noise * rng.normal(size=(8, 6))), covariance), np.stack(truth)


def test_poses_of_a_loop_without_noise_are_the_true_ones():
    edges, truth = chain_with_loop(0.0)
    bent = truth @ se3.exp(np.random.default_rng(0).normal(0, 0.1, (8, 6)))
    bent[0] = truth[0]
    found = System.of(edges, bent, np.array([0])).solved(bent)
    np.testing.assert_allclose(found, truth, atol=1e-6)


def test_no_step_of_gauss_newton_lowers_the_cost():
    edges, truth = chain_with_loop(0.05)
    system = System.of(edges, truth, np.array([0]))
    found = system.solved(truth)
    further = system.solved(found)
    assert system.chi_squares(found).sum() <= (1 + 1e-5) * system.chi_squares(further).sum()
    np.testing.assert_allclose(found[0], truth[0], atol=1e-9)


def test_nodes_without_edges_stay():
    edges, truth = chain_with_loop(0.0)
    poses = np.concatenate([truth, se3.from_yaw(1.0, np.array([5.0, 6.0, 7.0]))[None]])
    found = System.of(edges, poses, np.array([0])).solved(poses)
    np.testing.assert_array_equal(found[8], poses[8])


def test_without_any_edge_nothing_moves():
    edges, truth = chain_with_loop(0.0)
    none = edges.subset(np.zeros(8, bool))
    np.testing.assert_array_equal(System.of(none, truth, np.array([0])).solved(truth), truth)


def test_poses_that_nothing_holds_keep_their_shape():
    edges, truth = chain_with_loop(0.0)
    moved = se3.from_yaw(0.5, np.array([100.0, 0.0, 0.0])) @ truth
    found = System.of(edges, moved, np.zeros(0, np.int64)).solved(moved)
    np.testing.assert_allclose(se3.between(found[:1], found), se3.between(truth[:1], truth), atol=1e-5)


def test_a_descent_cut_short_says_so_and_can_go_on():
    edges, truth = ring(6)
    bent = truth @ se3.exp(np.random.default_rng(6).normal(0, 0.3, (len(truth), 6)))
    bent[0] = truth[0]
    system, ones = System.of(edges, bent, np.array([0])), np.ones(len(edges))
    short = system.descent(bent, ones, steps=1)
    assert not short.converged
    assert system.cost(short.poses) < system.cost(bent)
    further = system.descent(short.poses, ones)
    assert further.converged
    np.testing.assert_allclose(further.poses, system.descent(bent, ones).poses, atol=1e-3)
