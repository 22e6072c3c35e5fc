from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.types import Measured, Prediction, PredictionKind, capped_covariance

WORST = np.array([0.05, 0.05, 0.05, 0.5, 0.5, 0.5])
AHEAD = se3.from_yaw(0.1, np.array([3.0, 0.0, 0.0]))


def test_shapes_are_checked() -> None:
    with pytest.raises(ValueError, match=r"measurement.*\(3, 3\).*expected \(4, 4\)"):
        Measured(np.eye(3), np.eye(6))
    with pytest.raises(ValueError, match=r"prediction.*covariance \(4, 4\)"):
        Prediction(np.eye(4), np.eye(4), PredictionKind.HEADING)


def test_a_prediction_widened_twice_has_four_times_the_variance_at_the_same_pose() -> None:
    wide = Prediction(AHEAD, np.eye(6), PredictionKind.HEADING).widened(2.0)
    np.testing.assert_array_equal(wide.covariance, 4.0 * np.eye(6))
    assert (wide.kind, wide.T_query_match is AHEAD) == (PredictionKind.HEADING, True)


@given(seed=st.integers(0, 10_000), scale=st.floats(1e-3, 100.0))
def test_no_stated_covariance_counts_beyond_what_a_closure_is_worth(seed: int, scale: float) -> None:
    root = scale * np.random.default_rng(seed).normal(0, WORST[:, None] / 3, (6, 6))
    stated = root @ root.T + 1e-9 * np.eye(6)
    units = np.outer(WORST, WORST)
    limited = capped_covariance(stated)
    assert (np.sqrt(np.diag(limited)) <= WORST * (1 + 1e-9)).all()
    before, after = np.linalg.eigvalsh(stated / units), np.linalg.eigvalsh(limited / units)
    np.testing.assert_allclose(after, np.minimum(before, 1.0), rtol=1e-6, atol=1e-12)
    # Nowhere vaguer than stated, and as exact as stated where that is exact.
    assert np.linalg.eigvalsh((stated - limited) / units).min() > -1e-9 * before[-1]


def test_what_is_known_well_across_a_vague_direction_stays_known_as_well() -> None:
    along, across = np.array([1.0, 1.0, 0.0]) / np.sqrt(2), np.array([1.0, -1.0, 0.0]) / np.sqrt(2)
    stated = np.diag(np.square([0.01, 0.01, 0.01, 0.0, 0.0, 0.1]))
    stated[3:, 3:] += 10.0**2 * np.outer(along, along) + 0.05**2 * np.outer(across, across)
    limited = capped_covariance(stated)[3:, 3:]
    assert np.isclose(across @ limited @ across, 0.05**2)
    assert np.isclose(along @ limited @ along, 0.5**2)


def test_a_covariance_that_is_no_number_says_nothing() -> None:
    np.testing.assert_allclose(np.sqrt(np.diag(capped_covariance(np.full((6, 6), np.inf)))), WORST)


def test_what_is_exact_stays_as_it_is() -> None:
    exact = np.diag(np.square([0.01, 0.01, 0.01, 0.1, 0.1, 0.1]))
    np.testing.assert_array_equal(capped_covariance(exact), exact)
