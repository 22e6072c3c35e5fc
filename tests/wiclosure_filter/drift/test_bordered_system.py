"""Normal equations of a chain with a border: the same as dense ones."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.wiclosure_filter.drift.bordered_system import BorderedSystem


def test_inverse_and_determinant_are_those_of_the_dense_system() -> None:
    rng, blocks, errors = np.random.default_rng(1), 5, 7
    rows = np.zeros((60, 4 * blocks + errors))
    for k, row in enumerate(rows):  # each touches two neighbouring blocks and the errors
        first = 4 * (k % (blocks - 1))
        row[first : first + 8], row[4 * blocks :] = rng.normal(size=8), rng.normal(size=errors)
    dense = rows.T @ rows
    chain = dense[: 4 * blocks, : 4 * blocks].reshape(blocks, 4, blocks, 4)
    at = np.arange(blocks)
    system = BorderedSystem(
        chain[at, :, at],
        chain[at[:-1], :, at[1:]],
        dense[: 4 * blocks, 4 * blocks :].reshape(blocks, 4, errors),
        dense[4 * blocks :, 4 * blocks :],
    )
    np.testing.assert_allclose(system.inverse, np.linalg.inv(dense), atol=1e-9)
    assert system.log_determinant == pytest.approx(np.linalg.slogdet(dense)[1])
