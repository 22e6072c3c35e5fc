"""An honest radio fits at the truth; a wrong one does not, and is told by what does not agree."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.likelihood.fit import Fit
from wiclosure.wiclosure_filter.likelihood.mixture import Mixture
from wiclosure.wiclosure_filter.likelihood.residuals import displacements_in_a, explained


def fit_at(state: FloatArray, mixture: Mixture) -> Fit:
    distance_m = np.linalg.norm(displacements_in_a(state[None], mixture.observations)[1][0], axis=1)
    return Fit.of(mixture, explained(state, mixture), distance_m)


@pytest.mark.parametrize("kind", ["one-way", "reciprocal", "range-only", "bearing-only"])
def test_perfect_measurements_fit_at_the_truth(kind: str, make_case: Callable[..., object]) -> None:
    case = make_case(kind, heard=24, false_paths=2)
    fit = fit_at(case.state, Mixture.of(case.problem.observations, case.problem.radio))
    assert fit.misfit(0.01) == ""
    assert fit.probability > 0.5
    assert fit.by_time.agreeing_ranges.sum() == fit.by_time.ranges.sum() == case.links.has_range.sum()
    assert fit.by_time.bearings.sum() == case.links.has_bearing.sum()
    assert (fit.by_time.agreeing_bearings <= fit.by_time.bearings).all()


def test_azimuths_from_nowhere_do_not_fit(make_case: Callable[..., object]) -> None:
    case = make_case(heard=30)
    observations = case.problem.observations
    angle = np.random.default_rng(0).uniform(-np.pi, np.pi, observations.weight.shape)
    scattered = observations.directed(np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1))
    fit = fit_at(case.state, Mixture.of(scattered, case.problem.radio))
    assert "30 bearings agree" in fit.misfit(0.01)
    assert "ranges" not in fit.misfit(0.01)


def test_ranges_cannot_be_shorter_than_the_distance(make_case: Callable[..., object]) -> None:
    """As many ranges too long are ascribed to gross errors behind walls; too short ones have no such excuse."""
    case = make_case("range-only", heard=40)
    observations = case.problem.observations
    for sign, doubtful in ((-1.0, True), (1.0, False)):
        wrong = np.where(np.arange(40) % 8 == 0, np.maximum(observations.range_m + 5 * sign, 0.0), observations.range_m)
        mixture = Mixture.of(replace(observations, range_m=wrong), case.problem.radio)
        assert ("shorter than the distance" in fit_at(case.state, mixture).misfit(0.01)) == doubtful


def test_a_few_measurements_are_no_ground_for_doubt(make_case: Callable[..., object]) -> None:
    case = make_case(heard=3)
    away = case.state + np.array([0.0, 0.0, 40.0, 0.0])
    assert fit_at(case.state, Mixture.of(case.problem.observations, case.problem.radio)).misfit(0.01) == ""
    assert fit_at(away, Mixture.of(case.problem.observations, case.problem.radio)).misfit(0.01) != ""
