"""The prior of constant errors against numerical integration of its mixture."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.drift.error_prior import ErrorPrior

PRIOR = ErrorPrior(np.full(7, 0.3), 0.02)


def density(error: np.ndarray) -> np.ndarray:
    """Of the mixture, up to a constant."""
    usual, blunder = (np.exp(-((error / sigma) ** 2) / 2) / sigma for sigma in (0.3, 3.0))
    return 0.98 * usual + 0.02 * blunder


@pytest.mark.parametrize(("told", "sigma"), [(0.0, 0.1), (0.2, 0.5), (0.8, 0.6), (3.0, 0.3), (5.0, 1.0), (0.0, 30.0)])
def test_the_posterior_is_as_wide_as_under_the_mixture(told: float, sigma: float) -> None:
    held, value = np.full(7, 0.3), np.zeros(7)
    for _ in range(50):
        variance = 1 / (1 / sigma**2 + 1 / held**2)
        value = variance * told / sigma**2
        held = PRIOR.held(value, np.sqrt(variance), held)
    error = np.linspace(-40, 40, 400_001)
    posterior = density(error) * np.exp(-(((error - told) / sigma) ** 2) / 2)
    posterior /= posterior.sum()
    expected = posterior @ error**2 - (posterior @ error) ** 2
    # Never narrower than a usual error leaves it, never wider than a blunder does.
    bounds = [1 / (1 / sigma**2 + 1 / limit**2) for limit in (0.3, 3.0)]
    assert 1 / (1 / sigma**2 + 1 / held[0] ** 2) == pytest.approx(np.clip(expected, *bounds), rel=1e-3)


def test_the_density_is_that_of_the_mixture() -> None:
    value = np.array([0.1, 0.3, 0.9, 3.0, 9.0, 0.0, -2.0])
    assert PRIOR.squared(value) == pytest.approx(-2 * np.log(density(value) / density(np.zeros(7))).sum())
    assert PRIOR.squared(np.zeros(7)) == 0.0


def test_without_blunders_it_is_a_gaussian() -> None:
    prior = ErrorPrior.of(CalibrationPriors(blunder_share=0.0))
    value = 5 * prior.usual
    assert prior.squared(value) == pytest.approx(7 * 25)
    np.testing.assert_allclose(prior.held(value, 0.5 * prior.usual, prior.usual), prior.usual)
    assert prior.seldom(value) == pytest.approx(7 * 25)


def test_errors_as_seldom_are_of_chi_square_distribution() -> None:
    """By their density, 6 % of such logs lie beyond what one of a hundred should."""
    rng = np.random.default_rng(4)
    blunder = rng.random((4000, 7)) < PRIOR.blunder_share
    drawn = np.where(blunder, 3.0, 0.3) * rng.normal(size=blunder.shape)
    limit = chi2.isf(0.01, 7)
    assert np.mean([PRIOR.seldom(value) for value in drawn]) == pytest.approx(7.0, rel=0.05)
    assert np.mean([PRIOR.seldom(value) > limit for value in drawn]) == pytest.approx(0.01, abs=0.005)
    assert np.mean([PRIOR.squared(value) > limit for value in drawn]) > 0.03
