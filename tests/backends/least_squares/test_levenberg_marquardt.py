"""Poses by GTSAM's solver."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.edges import Edges, System


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
    found = System.of(edges, 8, np.array([0])).solved(bent)
    np.testing.assert_allclose(found, truth, atol=1e-6)


def test_no_step_of_gauss_newton_lowers_the_cost():
    edges, truth = chain_with_loop(0.05)
    system = System.of(edges, 8, np.array([0]))
    found = system.solved(truth)
    further, _ = system._descended(found, np.ones(8), 30)
    assert system.chi_squares(found).sum() <= (1 + 1e-5) * system.chi_squares(further).sum()
    np.testing.assert_allclose(found[0], truth[0], atol=1e-9)


def test_nodes_without_edges_stay():
    edges, truth = chain_with_loop(0.0)
    poses = np.concatenate([truth, se3.from_yaw(1.0, np.array([5.0, 6.0, 7.0]))[None]])
    found = System.of(edges, 9, np.array([0])).solved(poses)
    np.testing.assert_array_equal(found[8], poses[8])


def test_without_any_edge_nothing_moves():
    edges, truth = chain_with_loop(0.0)
    none = edges.subset(np.zeros(8, bool))
    np.testing.assert_array_equal(System.of(none, 8, np.array([0])).solved(truth), truth)


def test_poses_that_nothing_holds_keep_their_shape():
    edges, truth = chain_with_loop(0.0)
    moved = se3.from_yaw(0.5, np.array([100.0, 0.0, 0.0])) @ truth
    found = System.of(edges, 8, np.zeros(0, np.int64)).solved(moved)
    np.testing.assert_allclose(se3.between(found[:1], found), se3.between(truth[:1], truth), atol=1e-5)
