from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.backends.least_squares.normal_matrix import NormalMatrix


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


def test_a_matrix_that_rounding_leaves_without_a_gauge_is_solved():
    """Two chains, one held; nothing but the least information holds the other, far below what is rounded."""
    first, second = np.array([0, 1, 3, 4]), np.array([1, 2, 4, 5])
    J = np.tile(1e5 * np.eye(6), (4, 1, 1))
    factor = NormalMatrix.of(first, second, 6).factorised(J, -J, np.ones(4), np.array([0]), 0.0)
    right = np.zeros((6, 6))
    right[2], right[5], right[3] = 1.0, 1.0, -1.0
    found = factor.solve(right)
    np.testing.assert_allclose(found[2] - found[0], 2e-10 * np.ones(6), rtol=1e-3)
    np.testing.assert_allclose(found[5] - found[3], 2e-10 * np.ones(6), rtol=1e-3)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(2, 60), edges=st.integers(0, 30))
def test_halves_make_the_products_of_whole_solutions(seed, size, edges):
    """`(L^-1 a)^T (L^-1 b) = a^T H^-1 b`, where a stands at few nodes and b at all."""
    rng = np.random.default_rng(seed)
    first = np.concatenate([np.arange(size - 1), rng.integers(0, size - 1, edges)])
    second = np.concatenate([np.arange(1, size), rng.integers(first[size - 1 :] + 1, size)])
    A, B = rng.normal(size=(2, len(first), 3, 3))
    factor = NormalMatrix.of(first, second, size).factorised(A, B, np.ones(len(first)), np.array([0]), 0.01)
    nodes = rng.choice(size, min(size, 3), replace=False)
    a, b = np.zeros((size, 3, 2)), rng.normal(size=(size, 3, 4))
    a[nodes] = rng.normal(size=(len(nodes), 3, 2))
    rows, of_a = factor.half_solved(nodes, a[nodes])
    all_rows, of_b = factor.half_solved(np.arange(size), b)
    assert all_rows.tolist() == list(range(3 * size))
    wanted = a.reshape(-1, 2).T @ factor.solve(b).reshape(-1, 4)
    np.testing.assert_allclose(of_a.T @ of_b[rows], wanted, rtol=1e-7, atol=1e-9 * np.abs(wanted).max())
