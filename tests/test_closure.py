from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.types import worth_having

WORST = np.array([0.05, 0.05, 0.05, 0.5, 0.5, 0.5])


@given(seed=st.integers(0, 10_000), scale=st.floats(1e-3, 100.0))
def test_no_stated_covariance_is_believed_beyond_what_a_closure_is_worth(seed: int, scale: float) -> None:
    root = scale * np.random.default_rng(seed).normal(0, WORST[:, None] / 3, (6, 6))
    stated = root @ root.T + 1e-9 * np.eye(6)
    limited = worth_having(stated)
    sigma, before = np.sqrt(np.diag(limited)), np.sqrt(np.diag(stated))
    assert (sigma <= WORST * (1 + 1e-9)).all()
    np.testing.assert_allclose(sigma, np.minimum(before, WORST))
    assert np.linalg.eigvalsh(limited).min() > 0
    correlation = limited / np.outer(sigma, sigma)
    np.testing.assert_allclose(correlation, stated / np.outer(before, before), atol=1e-9)


def test_what_is_exact_stays_as_it_is() -> None:
    exact = np.diag(np.square([0.01, 0.01, 0.01, 0.1, 0.1, 0.1]))
    np.testing.assert_array_equal(worth_having(exact), exact)
