"""Chains that stand one after the other, and know nothing of each other."""

from __future__ import annotations

import numpy as np

from wiclosure.wiclosure_filter.alignment.linear_chains import LinearChains, Segments


def test_sums_and_extremes_are_those_of_each_chain() -> None:
    segments = Segments.of([2, 1, 3])
    np.testing.assert_array_equal(segments.chain, [0, 0, 1, 2, 2, 2])
    np.testing.assert_array_equal(segments.within, [True, False, False, True, True])
    values = np.arange(6.0)
    np.testing.assert_array_equal(segments.sums(values), [1, 2, 12])
    np.testing.assert_array_equal(segments.sums(np.where(segments.within, values[:5], 0.0)), [0, 0, 7])
    np.testing.assert_array_equal(segments.largest(np.column_stack([values, 5 - values])), [5, 3, 5])


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
        system = chains.chain(number).system
        expected_blocks, expected_errors = system.solved()
        np.testing.assert_allclose(blocks[first:end].reshape(-1), expected_blocks, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(errors[number], expected_errors, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(chains.covariance_of_errors[number], system.covariance_of_errors(), rtol=1e-9)
