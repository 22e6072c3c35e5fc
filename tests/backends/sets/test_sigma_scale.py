from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.sets import sigma_scale
from wiclosure.backends.sets.alignment import ClosureComparison
from wiclosure.backends.sets.claims import Claims

SIGMA = np.repeat([0.01, 0.1], 3)
LIMIT = float(chi2.ppf(0.99, 6))
MOST = 8.0


def comparison(seed, factor, true=30, false=10):
    """Closures between two groups whose errors are `factor` times what is stated, and unrelated ones."""
    rng, n = np.random.default_rng(seed), true + false
    T_a, T_b = (se3.from_yaw(rng.uniform(-3, 3, n), rng.normal(0, 20, (n, 3))) for _ in range(2))
    T = se3.between(T_a, T_b) @ se3.exp(factor * rng.normal(size=(n, 6)) * SIGMA)
    T[true:] = se3.from_yaw(rng.uniform(-3, 3, false), rng.normal(0, 5, (false, 3)))
    still = np.zeros((n, 6, 100))
    claims = Claims(T_a, T_b, T, np.tile(np.diag(SIGMA**2), (n, 1, 1)), still, still)
    return ClosureComparison.of(claims, LIMIT * (2.0 * MOST) ** 2)


@pytest.mark.parametrize("factor", [0.2, 1.0, 5.0])
def test_residuals_tell_the_factor(factor):
    residuals = factor**2 * np.random.default_rng(0).chisquare(6, 5000)
    assert sigma_scale.of_residuals(residuals) == pytest.approx(factor, rel=0.05)


def test_heavy_tails_ask_for_more_than_the_middle_does():
    residuals = np.random.default_rng(1).chisquare(6, 5000)
    residuals[:500] *= 16.0
    assert sigma_scale.of_residuals(residuals) > 1.3


def test_too_few_residuals_tell_nothing():
    enough = np.full(sigma_scale.ENOUGH, 6.0)
    assert sigma_scale.of_residuals(enough) is not None
    assert sigma_scale.of_residuals(enough[1:]) is None


@pytest.mark.parametrize("degrees", [3, 6])
def test_residuals_of_one_distribution_are_not_far_apart_and_those_of_two_are(degrees):
    rng = np.random.default_rng(2)
    alike = [rng.chisquare(degrees, 30) for _ in range(300)]
    assert not any(sigma_scale.far_apart(of, degrees) for of in alike)
    assert all(sigma_scale.far_apart(np.append(of, 100 * of[:10]), degrees) for of in alike)
    assert not sigma_scale.far_apart(np.zeros(0), degrees)


@pytest.mark.parametrize("factor", [1.0, 4.0])
def test_sets_between_robots_tell_the_factor(factor):
    assert sigma_scale.of_sets([comparison(2, factor)], LIMIT, MOST) == pytest.approx(factor, rel=0.35)


def test_sigma_stated_too_large_is_never_found_larger_still_nor_smaller_than_it_is():
    assert 0.2 < sigma_scale.of_sets([comparison(2, 0.3)], LIMIT, MOST) <= 1.0


def test_unrelated_closures_ask_for_nothing():
    assert sigma_scale.of_sets([comparison(3, 1.0, true=0, false=30)], LIMIT, MOST) == 1.0
    assert sigma_scale.of_sets([], LIMIT, MOST) == 1.0


@pytest.mark.parametrize(
    ("scale", "expected"),
    [(1.4, 1.0), (0.7, 1.0), (1.6, 1.6), (0.6, 0.6), (100.0, 8.0), (1e-9, sigma_scale.least(MOST))],
)
def test_near_one_is_one_and_far_is_bounded(scale, expected):
    assert sigma_scale.settled(scale, sigma_scale.least(MOST), MOST) == expected
