"""Rows, columns and neighbouring blocks of a large inverse are those of the dense one, whatever was asked before."""

from __future__ import annotations

import numpy as np

from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.covariance.cliques import Eliminated
from wiclosure.wiclosure_filter.covariance.square_root import SquareRoot

from .plan import FIRST, LENGTH, inverse, plan

GRAPH = plan()
INVERSE = inverse(GRAPH)


def cross(root: SquareRoot, a: np.ndarray, b: np.ndarray) -> FloatArray:
    """`(n, 6, m, 6)` by the rows of both."""
    rows = []
    for poses in (a, b):
        values, cliques = root.rows(poses, np.tile(np.eye(6), (len(poses), 1, 1)))
        whole = np.zeros((len(root.cliques), FIRST[-1] * 6, len(poses), 6))
        ends = 6 * np.cumsum(root.lengths(cliques))
        for number, end, size in zip(cliques, ends, 6 * root.lengths(cliques), strict=True):
            whole[number, :size] = values[end - size : end]
        rows.append(whole.reshape(-1, len(poses), 6))
    return np.einsum("cni,cmj->nimj", *rows)


def test_rows_give_all_covariances_of_two_chains() -> None:
    root = SquareRoot.of(Eliminated.of(GRAPH))
    for a, b in ((0, 15), (5, 6), (0, 1), (9, 9)):
        n, m = (np.arange(FIRST[chain], FIRST[chain + 1]) for chain in (a, b))
        np.testing.assert_allclose(cross(root, n, m), INVERSE[n][:, :, m], rtol=1e-9, atol=1e-12)


def test_columns_are_those_of_the_inverse() -> None:
    root, ones = SquareRoot.of(Eliminated.of(GRAPH)), np.array([0, FIRST[3] + 7, FIRST[-1] - 1, 0])
    asked = [np.arange(FIRST[3], FIRST[4]), np.arange(FIRST[-1]), np.array([FIRST[-1] - 1]), np.zeros(0, np.int64)]
    for poses, one, found in zip(asked, ones, root.with_ones(asked, ones), strict=True):
        np.testing.assert_allclose(found, INVERSE[poses, :, one], rtol=1e-9, atol=1e-12)


def test_chains_have_their_own_blocks_and_those_of_neighbours() -> None:
    n = np.arange(FIRST[-1])
    own, following = SquareRoot.of(Eliminated.of(GRAPH)).near(n[:-1], n[1:])
    np.testing.assert_allclose(own, np.einsum("ninj->nij", INVERSE), rtol=1e-9, atol=1e-12)
    for key in range(FIRST[-1] - 1):
        if (key + 1) % LENGTH:
            np.testing.assert_allclose(following[key], INVERSE[key, :, key + 1], rtol=1e-9, atol=1e-12)
