"""Gates against Monte Carlo, against geometry that is known, and against their own bounds."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.wiclosure_filter.search.ball_probability import probability_within
from wiclosure.wiclosure_filter.search.gates import (
    MahalanobisGate,
    OverlapProbabilityGate,
    mahalanobis_distance,
    probability_bound,
    spread,
)

from .random_places import random_gaussians


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), d=st.sampled_from([2, 3]))
def test_no_probability_exceeds_its_bound(seed: int, d: int) -> None:
    mean, covariance = random_gaussians(seed, 200, d, 10.0)
    bound = probability_bound(np.linalg.norm(mean, axis=1), *spread(covariance), 10.0)
    assert (probability_within(mean, covariance, 10.0) <= bound + 1e-4).all()


def test_certain_pairs() -> None:
    """Ten metres apart for certain: scans overlap, but it is not the same place (the paper's gate drops it)."""
    displacement, covariance = np.array([[10.0, 0.0], [50.0, 0.0]]), np.full((2, 1, 1), 0.01) * np.eye(2)
    overlap = OverlapProbabilityGate(35.0, 0.05).score(displacement, covariance)
    same_place = MahalanobisGate(3.0, 35.0).score(displacement, covariance)
    assert overlap.keep.tolist() == [True, False]
    np.testing.assert_allclose(overlap.overlap_probability, [1.0], atol=1e-5)
    np.testing.assert_allclose(overlap.mahalanobis, [100.0])
    assert same_place.keep.tolist() == [False, False]


def test_unknown_places_are_not_kept_by_ignorance() -> None:
    """Were every pair within its deviation kept, ignorance would keep everything; the paper's gate does so."""
    displacement, covariance = np.array([[300.0, 0.0]]), 1000.0**2 * np.eye(2)[None]
    assert not OverlapProbabilityGate(35.0, 0.05).score(displacement, covariance).keep[0]
    assert MahalanobisGate(3.0, 35.0).score(displacement, covariance).keep[0]


def test_mahalanobis_is_the_papers_equation() -> None:
    mean, covariance = random_gaussians(7, 100, 3, 5.0)
    expected = [np.sqrt(x @ np.linalg.inv(C) @ x) for x, C in zip(mean, covariance, strict=True)]
    np.testing.assert_allclose(mahalanobis_distance(mean, covariance), expected, rtol=1e-6)


def test_no_pairs_at_all() -> None:
    for gate in (OverlapProbabilityGate(35.0, 0.05), MahalanobisGate(3.0, 35.0)):
        scores = gate.score(np.zeros((0, 2)), np.zeros((0, 2, 2)))
        assert scores.keep.shape == scores.overlap_probability.shape == scores.mahalanobis.shape == (0,)
