from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.least_squares.cholesky import Pattern
from wiclosure.backends.least_squares.fronts import fronts_of


@pytest.mark.parametrize("width", [1, 3])
def test_factors_are_those_of_the_dense_matrix(width):
    rng, size = np.random.default_rng(5), 150
    first = np.concatenate([np.arange(size - 1), rng.integers(0, size - 40, 60)])
    second = np.concatenate([np.arange(1, size), first[size - 1 :] + rng.integers(2, 40, 60)])
    position, fronts = fronts_of(first, second, size)
    low, high = np.minimum(position[first], position[second]), np.maximum(position[first], position[second])
    rows, columns = np.concatenate([low, np.arange(size)]), np.concatenate([high, np.arange(size)])
    blocks = rng.normal(size=(len(rows), width, width))
    blocks[len(first) :] = 40.0 * np.eye(width)
    H = np.zeros((size, width, size, width))
    np.add.at(H, (rows, slice(None), columns), blocks)
    H = H.reshape(width * size, -1)
    H = np.triu(H) + np.triu(H, 1).T
    right = rng.normal(size=(width * size, 4))
    found = Pattern.of(fronts, rows, columns, size).factorised(blocks)
    assert len(fronts) > 5
    np.testing.assert_allclose(found.solve(right), np.linalg.solve(H, right), rtol=1e-9, atol=1e-12)


def test_a_matrix_that_is_not_positive_has_no_factors():
    pattern = Pattern.of(fronts_of(np.array([0]), np.array([1]), 2)[1], np.array([0, 0, 1]), np.array([0, 1, 1]), 2)
    assert pattern.factorised(np.array([1.0, 2.0, 1.0]).reshape(3, 1, 1)) is None
