from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.backends.least_squares.normal_matrix import NormalMatrix, elimination_positions


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(2, 30), edges=st.integers(0, 60))
def test_it_solves_what_the_dense_matrix_solves(seed, size, edges):
    rng = np.random.default_rng(seed)
    first = rng.integers(0, size - 1, edges)
    second = rng.integers(first + 1, size)
    A, B, weights = rng.normal(size=(edges, 6, 6)), rng.normal(size=(edges, 6, 6)), rng.uniform(0.1, 1.0, edges)
    J = np.zeros((edges, 6, size, 6))
    J[np.arange(edges), :, first], J[np.arange(edges), :, second] = A, B
    J = J.reshape(6 * edges, 6 * size)
    H = J.T @ (np.repeat(weights, 6)[:, None] * J)
    H += 0.1 * np.diag(np.diag(H)) + 1e-9 * np.eye(6 * size)
    H[:6, :6] += 1e12 * np.eye(6)
    right = H @ rng.normal(size=(6 * size, 3))
    matrix = NormalMatrix.of(first, second, size)
    found = matrix.factorised(A, B, weights, np.array([0]), 0.1).solve(right.reshape(size, 6, 3))
    np.testing.assert_allclose(H @ found.reshape(6 * size, 3), right, rtol=1e-5, atol=1e-5 * np.abs(right).max())


def test_what_edges_have_at_their_ends_is_summed_at_the_nodes():
    first, second = np.array([0, 0, 2]), np.array([1, 2, 1])
    at_first, at_second = np.full((3, 6, 2), 1.0), np.full((3, 6, 2), 10.0)
    found = NormalMatrix.of(first, second, 4).gathered(at_first, at_second)
    np.testing.assert_array_equal(found[:, 0, 0], [2.0, 20.0, 11.0, 0.0])


def test_factors_of_a_grid_stay_sparse():
    """A band matrix would hold side^3 blocks; nested dissection holds side^2 log side."""
    side = 30
    nodes = np.arange(side * side).reshape(side, side)
    first = np.concatenate([nodes[:, :-1].ravel(), nodes[:-1].ravel()])
    second = np.concatenate([nodes[:, 1:].ravel(), nodes[1:].ravel()])
    J = np.tile(np.eye(6), (len(first), 1, 1))
    factor = NormalMatrix.of(first, second, side * side).factorised(J, -J, np.ones(len(first)), np.array([0]), 0.0)
    blocks = factor.of.L.nnz / 6
    assert blocks < 0.6 * side**3


@pytest.mark.parametrize(("first", "second", "size"), [([], [], 3), ([0], [1], 5), ([4, 1], [1, 2], 6)])
def test_every_node_has_a_place_joined_or_not(first, second, size):
    positions = elimination_positions(np.array(first, int), np.array(second, int), size)
    assert sorted(positions.tolist()) == list(range(size))


def test_every_node_has_a_place_where_metis_fails(monkeypatch):
    monkeypatch.setattr(gtsam.Ordering, "MetisSymbolicFactorGraph", lambda graph: gtsam.Ordering())
    position = elimination_positions(np.arange(9), np.arange(1, 10), 10)
    assert sorted(position.tolist()) == list(range(10))
