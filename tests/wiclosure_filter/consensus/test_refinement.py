"""Climbing ends at the truth; gradient and information are those of the posterior."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.consensus.refinement import (
    Peaks,
    Prior,
    climb,
    displacement_m,
    first_distinct,
    normal_equations,
)
from wiclosure.wiclosure_filter.likelihood.mixture import Mixture
from wiclosure.wiclosure_filter.likelihood.residuals import explained

KINDS = ["heading", "reciprocal", "one-way", "range-only"]


def log_posterior(state: FloatArray, mixture: Mixture, prior: Prior) -> float:
    likelihood = explained(state, mixture).log_likelihood[0] @ mixture.observations.independence
    return float(likelihood + prior.log_density(state[None])[0])


def gradient_of(function: Callable[[FloatArray], float], state: FloatArray, step: float = 1e-5) -> FloatArray:
    return np.array([(function(state + e) - function(state - e)) / (2 * step) for e in step * np.eye(4)])


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("elevated", [False, True])
def test_noise_free_measurements_are_climbed_to_the_truth(
    kind: str, elevated: bool, make_case: Callable[..., object]
) -> None:
    case = make_case(kind, elevated=elevated, height_sigma_m=1e3)
    mixture, _ = case.problem.anchored_at(0)
    start = case.state + np.array([0.02, 0.1, -0.1, 0.05 * elevated])
    peaks = climb(start[None], mixture, case.problem.prior)
    np.testing.assert_allclose(peaks.states[0], case.state, atol=1e-4)
    assert peaks.log_posterior[0] == pytest.approx(log_posterior(peaks.states[0], mixture, case.problem.prior))


@pytest.mark.parametrize(("kind", "elevated"), [*((kind, False) for kind in KINDS), ("range-only", True)])
def test_information_is_the_curvature_at_the_truth(kind: str, elevated: bool, make_case: Callable[..., object]) -> None:
    """Where residuals vanish, Gauss-Newton leaves nothing out of the Hessian."""
    case = make_case(kind, elevated=elevated)
    mixture, _ = case.problem.anchored_at(0)
    prior = replace(case.problem.prior, height_m=float(case.state[3]))
    peaks = Peaks.at(case.state[None], mixture, prior)
    at = lambda state: gradient_of(lambda s: log_posterior(s, mixture, prior), state)  # noqa: E731
    hessian = np.array([(at(case.state + e) - at(case.state - e)) / 2e-3 for e in 1e-3 * np.eye(4)])
    np.testing.assert_allclose(peaks.information[0], -hessian, atol=1e-3 * np.abs(hessian).max())


def test_gradient_of_ranges_is_exact_away_from_the_truth_too(make_case: Callable[..., object]) -> None:
    """Expected residuals of a mixture are its gradient (Fisher's identity), gross errors and bias included."""
    case = make_case("range-only", elevated=True, radio={"range_biased": 0.15})
    mixture, _ = case.problem.anchored_at(0)
    prior = case.problem.prior
    for seed in range(5):
        state = case.state + np.random.default_rng(seed).normal(0, [0.02, 0.3, 0.3, 0.1])
        _, _, gradient = normal_equations(state[None], mixture, prior)
        expected = gradient_of(lambda s: log_posterior(s, mixture, prior), state)
        np.testing.assert_allclose(gradient[0], expected, atol=1e-4 * np.abs(expected).max())


def test_prior_terms_are_the_derivatives_of_its_density() -> None:
    prior = Prior(yaw=0.4, yaw_sigma=0.1, height_m=1.0, height_sigma_m=2.0)
    state = np.array([0.45, 3.0, 4.0, 2.0])
    information, gradient = np.zeros((1, 4, 4)), np.zeros((1, 4))
    prior.add_to(state[None], information, gradient)
    expected = gradient_of(lambda s: float(prior.log_density(s[None])[0]), state)
    np.testing.assert_allclose(gradient[0], expected, atol=1e-6)
    np.testing.assert_allclose(np.diag(information[0]), [100.0, 0.0, 0.0, 0.25])
    blind = Prior(np.nan, np.nan, 0.0, 2.0)
    assert blind.log_density(state[None])[0] == pytest.approx(-0.5)


def test_prior_of_headings(make_case: Callable[..., object]) -> None:
    case = make_case("heading")
    prior = Prior.of(case.problem.observations, use_headings=True, height_sigma_m=2.0)
    assert prior.yaw == pytest.approx(float(se3.yaw(case.T_a_b)), abs=1e-6)
    assert prior.yaw_sigma == pytest.approx(0.05 * np.sqrt(2))  # as sure as one reading, however many there are
    assert prior.height_sigma_m == 2.0
    assert np.isnan(Prior.of(case.problem.observations, use_headings=False, height_sigma_m=2.0).yaw)


def test_displacement_is_the_root_mean_square_of_b_moved(make_case: Callable[..., object]) -> None:
    observations = make_case().problem.observations
    one, other = np.array([0.3, 1.0, 2.0, 0.0]), np.array([-0.4, 3.0, -2.0, 5.0])
    moved = [se3.transform(se3.from_yaw(s[0], s[1:]), observations.b)[:, :2] for s in (one, other)]
    expected = np.sqrt(((moved[0] - moved[1]) ** 2).sum(axis=1).mean())
    assert displacement_m(one, other, observations) == pytest.approx(expected)


def test_distinct_peaks_are_the_best_of_each_place(make_case: Callable[..., object]) -> None:
    observations = make_case().problem.observations
    states = np.array([[0, 0, 0, 0], [0, 0.1, 0, 0], [0, 5, 0, 0], [0, 5.1, 0, 0]], float)
    peaks = Peaks(states, np.array([1.0, 2.0, 4.0, 3.0]), np.tile(np.eye(4), (4, 1, 1))).distinct(observations)
    assert peaks.states[:, 1].tolist() == [5.0, 0.1]
    assert peaks.log_posterior.tolist() == [4.0, 2.0]


def test_first_distinct_takes_the_first_of_near_ones() -> None:
    at = np.array([0.0, 0.1, 1.0, 1.05, 2.0])
    assert first_distinct(5, lambda row: np.abs(at - at[row]), 0.3).tolist() == [0, 2, 4]
    assert first_distinct(5, lambda row: np.abs(at - at[row]), 0.3, limit=2).tolist() == [0, 2]
    assert first_distinct(0, lambda row: at, 0.3).tolist() == []
