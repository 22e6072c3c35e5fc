"""Probabilities of Gaussian displacements in a ball: closed forms, Monte Carlo, and their limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, ncx2

from wiclosure.wiclosure_filter.search.ball_probability import principal_axes, probability_within

from .random_places import random_gaussians


@pytest.mark.parametrize("d", [2, 3])
def test_probability_agrees_with_monte_carlo(d: int) -> None:
    mean, covariance = random_gaussians(3, 60, d, 35.0)
    rng = np.random.default_rng(4)
    draws = 40_000
    sample = mean[:, None] + rng.normal(size=(60, draws, d)) @ np.swapaxes(np.linalg.cholesky(covariance), 1, 2)
    share = (np.linalg.norm(sample, axis=2) <= 35.0).mean(axis=1)
    assert abs(probability_within(mean, covariance, 35.0) - share).max() < 4.5 * 0.5 / np.sqrt(draws)


@pytest.mark.parametrize("d", [2, 3])
def test_probability_agrees_with_noncentral_chi_square(d: int) -> None:
    """For equal variances the squared distance is noncentral chi-square."""
    rng = np.random.default_rng(5)
    sigma, distance = 35.0 * 10 ** rng.uniform(-2, 1, 300), rng.uniform(0, 90, 300)
    mean = np.zeros((300, d))
    mean[:, 0] = distance
    expected = ncx2.cdf((35.0 / sigma) ** 2, d, (distance / sigma) ** 2)
    got = probability_within(mean, sigma[:, None, None] ** 2 * np.eye(d), 35.0)
    np.testing.assert_allclose(got, expected, atol=1e-4)


@settings(max_examples=50, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_principal_axes_rebuild_the_covariance(seed: int) -> None:
    _, covariance = random_gaussians(seed, 50, 2, 1.0)
    variance, axes = principal_axes(covariance)
    assert (variance[:, 0] <= variance[:, 1] * (1 + 1e-12)).all()
    rebuilt = axes * variance[:, None, :] @ np.swapaxes(axes, 1, 2)
    np.testing.assert_allclose(rebuilt, covariance, atol=1e-9 * np.abs(covariance).max())


@pytest.mark.parametrize("d", [2, 3])
def test_around_the_centre_the_square_is_chi_square(d: int) -> None:
    sigma = np.array([0.5, 5.0, 10.0, 50.0])
    expected = chi2.cdf((10.0 / sigma) ** 2, d)  # in the plane 1 - exp(-R^2 / 2 sigma^2)
    got = probability_within(np.zeros((4, d)), sigma[:, None, None] ** 2 * np.eye(d), 10.0)
    np.testing.assert_allclose(got, expected, atol=1e-4)


@pytest.mark.parametrize("d", [2, 3])
def test_certain_places_are_inside_or_outside(d: int) -> None:
    mean = np.zeros((3, d))
    mean[:, 0] = [9.0, 10.0, 11.0]
    got = probability_within(mean, np.tile(1e-4 * np.eye(d), (3, 1, 1)), 10.0)
    np.testing.assert_allclose(got, [1.0, 0.5, 0.0], atol=1e-3)  # on the edge: half the plane


def test_turning_everything_changes_nothing() -> None:
    mean, covariance = random_gaussians(1, 50, 2, 10.0)
    R = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    turned = probability_within(mean @ R.T, R @ covariance @ R.T, 10.0)
    np.testing.assert_allclose(turned, probability_within(mean, covariance, 10.0), atol=1e-4)
