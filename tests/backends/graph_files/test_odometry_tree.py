from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.graph_files.edge_table import edge_table
from wiclosure.backends.graph_files.odometry_tree import composed, odometry_tree

SIGMA = np.repeat([0.01, 0.05], 3)
SEEDS = st.integers(0, 2**32 - 1)


def drive(seed, n):
    """Poses along a winding path that starts at the origin."""
    rng = np.random.default_rng(seed)
    poses = [np.eye(4)]
    for step in se3.exp(rng.normal(size=(n - 1, 6)) * [0.05, 0.05, 0.3, 0.2, 0.2, 0.1] + [0, 0, 0, 1, 0, 0]):
        poses.append(poses[-1] @ step)
    return np.stack(poses)


def table(truth, ends, guesses=None, errors=None, may_be_false=None, loops=()):
    """Edges with the truth, or off by tangent vectors; rows in `loops` state another matrix."""
    ends = np.asarray(ends)
    T = se3.between(truth[ends[:, 0]], truth[ends[:, 1]])
    T = T if errors is None else T @ se3.exp(np.asarray(errors))
    covariance = np.tile(np.diag(SIGMA**2), (len(ends), 1, 1))
    covariance[list(loops)] *= 4
    guesses = np.full_like(truth, np.nan) if guesses is None else guesses
    return edge_table(ends, T, covariance, np.zeros(len(ends), bool) if may_be_false is None else may_be_false, guesses)


@settings(max_examples=30)
@given(seed=SEEDS, n=st.integers(1, 40))
def test_products_from_the_first_to_each_pose_of_any_tree(seed, n):
    rng = np.random.default_rng(seed)
    parents = np.array([0] + [int(rng.integers(0, i)) for i in range(1, n)])
    steps = se3.exp(rng.normal(size=(n, 6)))
    expected = [steps[0]]
    for i in range(1, n):
        expected.append(expected[parents[i]] @ steps[i])
    np.testing.assert_allclose(composed(parents, steps), expected, atol=1e-9)


@settings(max_examples=30)
@given(seed=SEEDS, n=st.integers(2, 15))
def test_steps_are_the_odometry_whatever_loops_there_are_and_whichever_way_they_are_written(seed, n):
    rng = np.random.default_rng(seed)
    truth = drive(seed, n)
    ends = [(i, i + 1) if rng.random() < 0.5 else (i + 1, i) for i in range(n - 1)]
    loops = [tuple(pair) for pair in rng.integers(0, n, (5, 2)).tolist() if abs(pair[0] - pair[1]) > 1]
    order = rng.permutation(n - 1 + len(loops))
    edges = table(truth, ends + loops, loops=range(n - 1, n - 1 + len(loops)))[order]
    tree = odometry_tree(n, edges)
    assert tree.is_chain
    assert tree.order.tolist() == list(range(n))
    np.testing.assert_allclose(tree.poses(truth[0]), truth, atol=1e-9)
    assert sorted(order[tree.rows].tolist()) == list(range(n - 1))


def test_covariances_of_edges_written_backwards_are_turned_too():
    truth = drive(3, 2)
    forward, backward = (odometry_tree(2, table(truth, [ends])) for ends in ((0, 1), (1, 0)))
    expected = se3.inverse_covariance(se3.between(truth[1], truth[0])[None], np.diag(SIGMA**2)[None])
    np.testing.assert_allclose(backward.covariances, expected, atol=1e-12)
    np.testing.assert_allclose(forward.covariances[0], np.diag(SIGMA**2), atol=1e-12)


def test_poses_between_which_no_step_leads_are_joined_by_an_edge_that_the_guesses_were_made_from():
    truth = drive(5, 8)
    ends = [(i, i + 1) for i in range(7) if i != 3] + [(2, 4), (0, 7)]
    errors = np.zeros((len(ends), 6))
    errors[-1, 3] = 3.0  # the other loop is false
    tree = odometry_tree(8, table(truth, ends, truth, errors))
    assert not tree.is_chain
    np.testing.assert_allclose(tree.poses(truth[0]), truth, atol=1e-9)
    assert len(ends) - 1 not in tree.rows


def test_where_no_edge_fits_the_guesses_exactly_a_robust_estimate_tells_which_join_best():
    truth = drive(6, 12)
    guesses = truth @ se3.exp(np.random.default_rng(0).normal(size=(12, 6)) * 0.02)
    steps = [(i, i + 1) for i in range(11) if i != 5]
    joins = [(4, 6), (5, 7), (3, 8), (0, 11)]
    errors = np.zeros((len(steps) + len(joins), 6))
    errors[-1, 3:] = 4.0  # the last one is false
    tree = odometry_tree(12, table(truth, steps + joins, guesses, errors))
    assert len(steps) + len(joins) - 1 not in tree.rows
    np.testing.assert_allclose(tree.poses(truth[0]), truth[tree.order], atol=1e-6)


def test_loops_that_may_be_false_come_last():
    truth = drive(7, 3)
    may_be_false = np.array([False, True, False])
    tree = odometry_tree(3, table(truth, [(0, 1), (1, 2), (0, 2)], truth, may_be_false=may_be_false))
    assert sorted(tree.rows.tolist()) == [0, 2]


def test_one_pose_has_no_steps():
    tree = odometry_tree(1, table(np.eye(4)[None], np.zeros((0, 2), np.int64)))
    assert tree.is_chain
    np.testing.assert_array_equal(tree.poses(np.eye(4)), np.eye(4)[None])
    assert len(tree.rows) == pytest.approx(0)
