from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.graph_files.edge_table import DIGITS_M, edge_table

COVARIANCE = np.diag(np.square([0.01] * 3 + [0.05] * 3))


def poses(seed, n=8):
    rng = np.random.default_rng(seed)
    return se3.exp(rng.normal(size=(n, 6)) * np.repeat([0.5, 20.0], 3))


def table(ends, T, guesses, may_be_false=False):
    ends = np.asarray(ends)
    covariance = np.tile(COVARIANCE, (len(ends), 1, 1))
    return edge_table(ends, T, covariance, np.full(len(ends), may_be_false), guesses)


@given(seed=st.integers(0, 2**32 - 1))
def test_edges_that_guesses_were_made_from_agree_to_the_last_digit_and_others_do_not(seed):
    guesses = poses(seed)
    ends = np.array([[0, 1], [1, 2], [5, 3], [7, 7]])
    T = se3.between(guesses[ends[:, 0]], guesses[ends[:, 1]])
    assert table(ends, T, guesses).exact.all()
    np.testing.assert_allclose(table(ends, T, guesses).chi_square, 0.0, atol=1e-6)
    off = T @ se3.exp(np.array([0.0, 0, 0, 0.05, 0, 0]))
    assert not table(ends, off, guesses).exact.any()
    np.testing.assert_allclose(table(ends, off, guesses).chi_square, 1.0, atol=1e-6)  # one sigma


def test_digits_are_relative_to_how_far_out_a_pose_lies_up_to_a_kilometre():
    guesses = np.tile(np.eye(4), (4, 1, 1))
    guesses[2:, 0, 3] = 500.0
    guesses = np.concatenate([guesses, guesses[2:] * 1e3])
    error_m = 100 * DIGITS_M
    T = np.tile(se3.from_yaw(0.0, np.array([error_m, 0.0, 0.0])), (2, 1, 1))
    misfit = table([[0, 1], [2, 3]], T, guesses).misfit
    np.testing.assert_allclose(misfit, [100.0, 100 / 501], rtol=1e-6)


def test_edges_without_guesses_agree_with_nothing():
    guesses = poses(0)
    guesses[3] = np.nan
    found = table([[2, 3], [0, 1]], np.tile(np.eye(4), (2, 1, 1)), guesses)
    assert np.isinf(found.misfit[0])
    assert np.isinf(found.chi_square[0])
    assert np.isfinite(found.misfit[1])


def test_steps_rows_numbers_and_matrices():
    found = table([[0, 1], [2, 1], [0, 2]], poses(1, 3), poses(2, 3))
    assert found.is_step().tolist() == [True, True, False]
    assert table([[0, 1]], poses(1, 1), poses(2, 3), may_be_false=True).is_step().tolist() == [False]
    assert len(found[found.is_step()]) == 2
    numbered = found.renumbered(np.array([10, 20, 30]))
    assert numbered.first.tolist() == [10, 30, 10]
    assert numbered.second.tolist() == [20, 20, 30]
    found.covariance[1] *= 2
    kinds = found.matrix_kinds()
    assert kinds[0] == kinds[2] != kinds[1]


@given(order=st.permutations(range(6)))
def test_the_order_of_the_files_does_not_matter(order):
    ends = np.array([[0, 1], [0, 1], [1, 2], [2, 0], [3, 1], [0, 3]])
    T, guesses, order = poses(3, 6), poses(4, 4), np.array(order)
    first, other = table(ends, T, guesses), table(ends[order], T[order], guesses)
    np.testing.assert_array_equal(first[first.canonical_order()].T, other[other.canonical_order()].T)


def test_no_edges():
    found = table(np.zeros((0, 2), np.int64), np.zeros((0, 4, 4)), poses(0))
    assert len(found) == 0
    assert found.exact.tolist() == []
    assert found.matrix_kinds().tolist() == pytest.approx([])


def test_a_matrix_seen_from_the_other_end_is_of_the_same_kind():
    T = poses(3, 4)
    stated = np.tile(COVARIANCE, (4, 1, 1))
    stated[2] = se3.inverse_covariance(se3.inverse(T[2]), COVARIANCE)  # of a backward edge
    stated[3] = 2.0 * COVARIANCE
    found = edge_table(np.array([[0, 1], [1, 2], [3, 2], [2, 3]]), T, stated, np.zeros(4, bool), poses(2, 4))
    kinds = found.matrix_kinds()
    assert kinds[0] == kinds[1] == kinds[2] != kinds[3]
