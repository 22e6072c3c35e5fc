"""The likelihood of one measurement, computed by hand, and of many, term by term."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.special import i0e

from wiclosure.types import AoaPath, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings, RadioModel
from wiclosure.wiclosure_filter.likelihood.mixture import Mixture
from wiclosure.wiclosure_filter.likelihood.observations import Observations
from wiclosure.wiclosure_filter.likelihood.residuals import explained
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks

STANDING = {name: Trajectory(name, np.array([0, 10**9]), np.tile(np.eye(4), (2, 1, 1))) for name in ("a", "b")}
RADIO = RadioModel(direct_path_absent=0.2, range_outlier=0.1, range_biased=0.3, range_bias_m=2.0, range_reach_m=100.0)


def mixture_of(
    measurement: WirelessMeasurement, drift: tuple[np.ndarray, np.ndarray] | None = None, radio: RadioModel = RADIO
) -> Mixture:
    log = WirelessLog((measurement,))
    links = TeamLinks.of(STANDING, log, GatheringLimits.of(AlignmentSettings())).by_pair["a", "b"]
    return Mixture.of(Observations.of(links, radio), radio, drift)


def at(azimuth: float, distance_m: float) -> np.ndarray:
    """The state that puts b there; with one measurement the centres are the antennas."""
    return np.array([[0.0, distance_m * np.cos(azimuth), distance_m * np.sin(azimuth), 0.0]])


def test_one_bearing_of_two_paths_by_hand() -> None:
    paths = (AoaPath(0.3, 0.1, weight=3.0), AoaPath(2.0, 0.2, weight=1.0))
    mixture = mixture_of(WirelessMeasurement(0, "a", "b", paths=paths))
    first = 0.75 / i0e(1 / 0.1**2) * np.exp((np.cos(0.4 - 0.3) - 1) / 0.1**2)
    second = 0.25 / i0e(1 / 0.2**2) * np.exp((np.cos(0.4 - 2.0) - 1) / 0.2**2)
    expected = np.log(0.2 + 0.8 * (first + second))
    assert mixture.log_likelihood(at(0.4, 7.0))[0] == pytest.approx(expected, rel=1e-5)
    explanation = explained(at(0.4, 7.0)[0], mixture)
    assert explanation.log_likelihood[0, 0] == pytest.approx(expected)
    assert explanation.path[0, 0, 0] == pytest.approx(0.8 * first / (0.2 + 0.8 * (first + second)))
    assert explanation.direct().tolist() == [0]


@pytest.mark.parametrize("elevation", [None, 0.2])
def test_a_bearing_that_may_be_anywhere_says_nothing(elevation: float | None) -> None:
    mixture = mixture_of(WirelessMeasurement(0, "a", "b", paths=(AoaPath(0.3, 17.0, elevation=elevation),)))
    assert mixture.log_likelihood(at(2.0, 7.0))[0] == pytest.approx(0.0, abs=0.01)


def test_one_range_by_hand() -> None:
    mixture = mixture_of(WirelessMeasurement(0, "a", "b", 12.0, 0.5))
    direct = 0.9 * 0.7 * 100 / np.sqrt(2 * np.pi) / 0.5 * np.exp(-(1.0**2) / (2 * 0.5**2))
    wide = 0.5**2 + 2.0**2
    biased = 0.9 * 0.3 * 100 / np.sqrt(2 * np.pi * wide) * np.exp(-((1.0 - 2.0) ** 2) / (2 * wide))
    assert mixture.log_likelihood(at(0.0, 11.0))[0] == pytest.approx(np.log(0.1 + direct + biased), rel=1e-5)
    explanation = explained(at(0.0, 11.0)[0], mixture)
    assert explanation.in_sight[0, 0] == pytest.approx(direct / (0.1 + direct + biased))
    assert explanation.obstructed[0, 0] == pytest.approx(biased / (0.1 + direct + biased))


def test_far_from_every_path_only_the_floors_are_left() -> None:
    mixture = mixture_of(WirelessMeasurement(0, "a", "b", 12.0, 0.5, (AoaPath(0.3, 0.1),)))
    assert mixture.log_likelihood(at(-2.0, 90.0))[0] == pytest.approx(np.log(0.2) + np.log(0.1), rel=1e-5)
    explanation = explained(at(-2.0, 90.0)[0], mixture)
    assert explanation.direct().tolist() == [-1]
    assert explanation.ranged().tolist() == [False]


@pytest.mark.parametrize("sigma", [0.05, 0.15, 0.3])
def test_over_all_directions_a_bearing_weighs_as_much_as_none(sigma: float) -> None:
    """The likelihood is relative to a uniform density, so its mean over the circle is one (wide ones nearly)."""
    mixture = mixture_of(WirelessMeasurement(0, "a", "b", paths=(AoaPath(0.3, sigma),)))
    around = np.concatenate([at(azimuth, 10.0) for azimuth in np.linspace(-np.pi, np.pi, 2000, endpoint=False)])
    assert np.exp(mixture.log_likelihood(around)).mean() == pytest.approx(1.0, abs=0.02)


def test_drift_widens_both_and_tells_less() -> None:
    measurement = WirelessMeasurement(0, "a", "b", 10.0, 0.5, (AoaPath(0.0, 0.1),))
    sharp, wide = mixture_of(measurement), mixture_of(measurement, (np.array([2.0]), np.array([0.3])))
    assert wide.kappa[0, 0] == pytest.approx(1 / (0.1**2 + 0.3**2 + 0.2**2))
    assert wide.range_variance[0] == pytest.approx(0.5**2 + 2.0**2)
    assert wide.log_likelihood(at(0.0, 10.0))[0] < sharp.log_likelihood(at(0.0, 10.0))[0]


def test_an_elevation_tells_height() -> None:
    path = AoaPath(0.0, 0.1, elevation=0.5)
    mixture = mixture_of(WirelessMeasurement(0, "a", "b", paths=(path,)))
    states = np.array([[0.0, np.cos(up), 0.0, np.sin(up)] for up in (0.5, 0.0)]) * [1, 10, 10, 10]
    on, off = mixture.log_likelihood(states)
    peak = 2 / 0.1**2  # density of a von Mises-Fisher distribution over that of the sphere
    assert on == pytest.approx(np.log(0.2 + 0.8 * peak), rel=1e-5)
    assert off == pytest.approx(np.log(0.2 + 0.8 * peak * np.exp((np.cos(0.5) - 1) / 0.1**2)), rel=1e-4)


@pytest.mark.parametrize("kind", ["reciprocal", "one-way", "range-only"])
def test_the_quick_sum_is_that_of_the_parts(kind: str, make_case: Callable[..., object]) -> None:
    """Single precision over all states, and double precision one by one; whichever robot received."""
    case = make_case(kind, false_paths=2)
    mixture, _ = case.problem.anchored_at(0)
    states = case.state + np.random.default_rng(1).normal(0, [0.2, 2, 2, 0], (20, 4))
    parts = [explained(state, mixture).log_likelihood[0] @ mixture.observations.independence for state in states]
    np.testing.assert_allclose(mixture.log_likelihood(states), parts, atol=2e-2)
    rows = np.array([0, 3, 5])
    np.testing.assert_allclose(
        mixture.subset(rows).log_likelihood(states),
        [explained(s, mixture).subset(rows).log_likelihood[0].sum() for s in states],
        atol=1e-2,
    )
