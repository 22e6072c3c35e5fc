"""Centred measurements, and how much each of them counts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.types import AoaPath, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings, RadioModel
from wiclosure.wiclosure_filter.likelihood.observations import Observations, independence
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.links.links import Links

STAMPS_NS = np.arange(10, dtype=np.int64) * 10**9


def links_of(measurements: list[WirelessMeasurement], speed_m_s: float = 1.0, climb_m_s: float = 0.0) -> Links:
    """a stands, b drives along x from (5, 0)."""
    along = np.stack([5 + speed_m_s * np.arange(10.0), np.zeros(10), climb_m_s * np.arange(10.0)], axis=1)
    team = {
        "a": Trajectory("a", STAMPS_NS, np.tile(np.eye(4), (10, 1, 1))),
        "b": Trajectory("b", STAMPS_NS, se3.from_yaw(np.zeros(10), along)),
    }
    limits = GatheringLimits.of(AlignmentSettings())
    return TeamLinks.of(team, WirelessLog(tuple(measurements)), limits).by_pair["a", "b"]


def ranged(second: float, range_m: float = 5.0) -> WirelessMeasurement:
    return WirelessMeasurement(round(second * 1e9), "a", "b", range_m, 0.5)


def heard(second: float, elevation: float | None = None) -> WirelessMeasurement:
    return WirelessMeasurement(round(second * 1e9), "a", "b", paths=(AoaPath(0.3, 0.1, elevation=elevation),))


@given(st.integers(0, 10**6))
def test_states_and_frame_transforms_are_inverse(seed: int) -> None:
    observations = Observations.of(links_of([ranged(1), ranged(5), ranged(9)]), RadioModel())
    rng = np.random.default_rng(seed)
    state = np.array([rng.uniform(-3, 3), *rng.uniform(-100, 100, 3)])
    np.testing.assert_allclose(observations.state(observations.frame_transform(state)), state, atol=1e-9)


def test_a_state_maps_centred_antennas() -> None:
    links = links_of([ranged(1), ranged(5)])
    observations = Observations.of(links, RadioModel())
    np.testing.assert_allclose(observations.b.mean(axis=0), 0, atol=1e-12)
    state = np.array([0.7, 3.0, -2.0, 1.0])
    mapped = se3.transform(observations.frame_transform(state), links.antenna_b)
    expected = se3.transform(se3.from_yaw(0.7, state[1:]), observations.b) + observations.centre_a
    np.testing.assert_allclose(mapped, expected, atol=1e-9)


def test_measurements_of_one_place_share_one_count() -> None:
    still = links_of([ranged(k) for k in range(4)], speed_m_s=0.0)
    np.testing.assert_allclose(independence(still, 1.0), 0.25)
    np.testing.assert_allclose(independence(still, 0.0), 1.0)
    moving = links_of([ranged(k) for k in range(4)], speed_m_s=3.0)
    np.testing.assert_allclose(independence(moving, 1.0), 1.0)
    mixed = links_of([ranged(1), ranged(2), heard(3)], speed_m_s=0.0)
    np.testing.assert_allclose(independence(mixed, 1.0), [0.5, 0.5, 1.0])  # a bearing repeats no range


def test_a_bearing_borrows_the_range_beside_it() -> None:
    observations = Observations.of(links_of([ranged(1, 6.0), heard(1.5), heard(8)]), RadioModel(range_partner_s=1.0))
    np.testing.assert_allclose(observations.near_range_m, [6.0, 6.0, np.nan])
    np.testing.assert_allclose(observations.near_range_sigma_m[1], np.hypot(0.5, 0.5))  # b moved half a metre since
    np.testing.assert_allclose(observations.distance_m, [6.0, 6.0, 30.0])
    assert observations.typical_distance_m == 6.0


def test_typical_distance_without_ranges_is_how_far_the_robots_moved() -> None:
    observations = Observations.of(links_of([heard(0), heard(9)]), RadioModel())
    assert observations.typical_distance_m == pytest.approx(9.0)
    assert observations.extents_m == pytest.approx((0.0, 9.0))


def test_heights_are_told_by_elevations_or_by_climbing() -> None:
    assert not Observations.of(links_of([ranged(1), heard(2)]), RadioModel()).tells_height
    assert Observations.of(links_of([ranged(1), heard(2, elevation=0.1)]), RadioModel()).tells_height
    assert Observations.of(links_of([ranged(0), ranged(9)], climb_m_s=1.0), RadioModel()).tells_height


def test_paths_without_elevation_are_laid_flat(make_case: Callable[..., object]) -> None:
    observations = make_case(elevated=True).problem.observations
    tilted = replace(observations, flat=np.ones_like(observations.flat)).directed(observations.direction)
    assert (tilted.direction[..., 2] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(tilted.direction, axis=-1), 1.0)
