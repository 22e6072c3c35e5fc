"""Chains that stand one after the other, and know nothing of each other."""

from __future__ import annotations

import numpy as np

from wiclosure.wiclosure_filter.drift.linear_chains import LinearChains, Segments


def test_sums_and_extremes_are_those_of_each_chain() -> None:
    segments = Segments.of([2, 1, 3])
    np.testing.assert_array_equal(segments.chain, [0, 0, 1, 2, 2, 2])
    np.testing.assert_array_equal(segments.within, [True, False, False, True, True])
    values = np.arange(6.0)
    np.testing.assert_array_equal(segments.sums(values), [1, 2, 12])
    np.testing.assert_array_equal(segments.sums(np.where(segments.within, values[:5], 0.0)), [0, 0, 7])
    np.testing.assert_array_equal(segments.largest(np.column_stack([values, 5 - values])), [5, 3, 5])


def dense(chains: LinearChains, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Matrix and right-hand side of one chain's blocks, and of its errors after them."""
    first, end = chains.segments.ends[number : number + 2].tolist()
    size = 4 * (end - first)
    matrix = np.zeros((size + 7, size + 7))
    for n, block in enumerate(range(first, end)):
        own = slice(4 * n, 4 * n + 4)
        matrix[own, own] = chains.diagonal[block]
        matrix[own, size:] = chains.border[block]
        if block + 1 < end:
            matrix[own, 4 * n + 4 : 4 * n + 8] = chains.upper[block]
    matrix[size:, size:] = chains.of_errors[number]
    matrix = np.triu(matrix) + np.triu(matrix, 1).T
    return matrix, np.concatenate([chains.gradient[first:end].ravel(), chains.gradient_of_errors[number]])


def test_the_solution_is_that_of_each_chain_alone() -> None:
    rng, segments = np.random.default_rng(0), Segments.of([4, 2, 5])
    size = int(segments.ends[-1])

    def positive(*shape: int) -> np.ndarray:
        root = rng.normal(size=shape)
        return root @ np.swapaxes(root, -1, -2) + 5 * np.eye(shape[-1])

    chains = LinearChains(
        segments,
        positive(size, 4, 4),
        rng.normal(size=(size - 1, 4, 4)) * 0.3 * segments.within[:, None, None],
        rng.normal(size=(size, 4)),
        rng.normal(size=(size, 4, 7)) * 0.3,
        positive(3, 7, 7),
        rng.normal(size=(3, 7)),
        *(np.zeros((size - 1, *shape)) for shape in ((4,), (4, 4), (4, 7), (4, 4))),
        np.arange(size),
    )
    blocks, errors = chains.solved()
    for number, (first, end) in enumerate(zip(segments.ends, segments.ends[1:], strict=False)):
        matrix, right = dense(chains, number)
        expected = np.linalg.solve(matrix, right)
        np.testing.assert_allclose(blocks[first:end].reshape(-1), expected[:-7], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(errors[number], expected[-7:], rtol=1e-9, atol=1e-12)
        covariance, system = np.linalg.inv(matrix), chains.chain(number).system
        np.testing.assert_allclose(chains.covariance_of_errors[number], covariance[-7:, -7:], rtol=1e-9)
        np.testing.assert_allclose(system.inverse, covariance, rtol=1e-9, atol=1e-12)
