"""Measurements that an alignment keeps, with the direction of the path that it takes for the direct one."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, AoaPath, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.shared.kept_links import UNKNOWN_ELEVATION, KeptLinks

T_WORLD_B = se3.from_yaw(0.6, np.array([3.0, 4.0, 0.0]))
STAMPS_NS = np.array([0, 10]) * 10**9
TEAM = {
    "a": Trajectory("a", STAMPS_NS, np.tile(np.eye(4), (2, 1, 1))),
    "b": Trajectory("b", STAMPS_NS, np.tile(np.eye(4), (2, 1, 1))),
}
TRUE = float(np.arctan2(4.0, 3.0))


def kept_of(*paths: AoaPath, chosen: int = 0, range_m: float = 5.0, receiver: str = "a", count: int = 1) -> KeptLinks:
    transmitter = "b" if receiver == "a" else "a"
    log = WirelessLog(
        tuple(WirelessMeasurement(k * 10**8, receiver, transmitter, range_m, 0.5, paths) for k in range(count))
    )
    links = TeamLinks.of(TEAM, log, GatheringLimits.of(AlignmentSettings())).by_pair["a", "b"]
    return KeptLinks.of(AlignmentHypothesis(T_WORLD_B, 0.0, tuple((k, chosen) for k in range(count))), links)


def test_repeats_at_one_place_count_as_one_measurement() -> None:
    paths = (AoaPath(TRUE, 0.2),)
    one, five = kept_of(*paths), kept_of(*paths, count=5).by_place(1.0)
    assert (five.links.range_sigma_m**-2).sum() == pytest.approx(0.5**-2)
    np.testing.assert_allclose(five.direction_covariance, 5 * np.repeat(one.direction_covariance, 5, axis=0))


def test_the_direction_is_that_of_the_chosen_path() -> None:
    kept = kept_of(AoaPath(1.0, 0.1), AoaPath(TRUE, 0.2), chosen=1)
    np.testing.assert_allclose(kept.direction, [[0.6, 0.8, 0.0]])
    across, up = np.array([-0.8, 0.6, 0.0]), np.array([0.0, 0.0, 1.0])
    C = kept.direction_covariance[0]
    assert across @ C @ across == pytest.approx(0.2**2)
    assert up @ C @ up == pytest.approx(UNKNOWN_ELEVATION**2)
    np.testing.assert_allclose(C @ kept.direction[0], 0, atol=1e-12)  # on the tangent plane


def test_a_measured_elevation_is_as_sure_as_the_path() -> None:
    C = kept_of(AoaPath(0.0, 0.2, elevation=0.5)).direction_covariance[0]
    assert np.sort(np.linalg.eigvalsh(C)) == pytest.approx([0.0, (0.2 * np.cos(0.5)) ** 2, 0.2**2])


def test_a_range_may_be_kept_without_a_path_and_others_not_at_all() -> None:
    assert np.isnan(kept_of(AoaPath(1.0, 0.1), chosen=-1).direction).all()
    log = WirelessLog(tuple(WirelessMeasurement(k * 10**9, "a", "b", 5.0, 0.5) for k in range(5)))
    links = TeamLinks.of(TEAM, log, GatheringLimits.of(AlignmentSettings())).by_pair["a", "b"]
    some = KeptLinks.of(AlignmentHypothesis(np.eye(4), 0.0, ((1, -1), (4, -1))), links)
    assert some.links.measurement.tolist() == [1, 4]


@pytest.mark.parametrize(("range_m", "misfit"), [(5.0, 0.0), (6.0, 2.0), (4.0, 2.0)])
def test_misfit_of_ranges_is_in_standard_deviations(range_m: float, misfit: float) -> None:
    kept = kept_of(range_m=range_m, chosen=-1, count=3)
    assert kept.misfit(np.tile(np.eye(4), (3, 1, 1)), np.tile(T_WORLD_B, (3, 1, 1))) == pytest.approx(misfit)


@pytest.mark.parametrize("receiver", ["a", "b"])
def test_misfit_of_bearings_is_in_standard_deviations(receiver: str) -> None:
    seen = TRUE if receiver == "a" else TRUE + np.pi - 0.6
    for off, expected in ((0.0, 0.0), (0.02, 1.0)):  # half of the residuals are the ranges', which fit
        kept = kept_of(AoaPath(float(se3.wrap_angle(np.array(seen + off))), 0.01), receiver=receiver)
        misfit = kept.misfit(np.eye(4)[None], T_WORLD_B[None])
        assert misfit == pytest.approx(expected, rel=1e-3, abs=1e-6)


def test_thinning_is_even_over_the_time() -> None:
    kept = kept_of(chosen=-1, count=21)
    assert kept.thinned(3).links.measurement.tolist() == [0, 10, 20]
    assert kept.thinned(21) is kept


def test_for_a_graph_directions_are_in_the_receivers_body() -> None:
    turned = {name: t.moved(se3.from_yaw(0.5, np.zeros(3))) for name, t in TEAM.items()}  # body axes in odometry
    log = WirelessLog((WirelessMeasurement(0, "a", "b", 5.0, 0.5, (AoaPath(0.3, 0.1),)),))
    links = TeamLinks.of(turned, log, GatheringLimits.of(AlignmentSettings())).by_pair["a", "b"]
    kept = KeptLinks.of(AlignmentHypothesis(np.eye(4), 0.0, ((0, 0),)), links)
    np.testing.assert_allclose(kept.direction[0], [np.cos(0.8), np.sin(0.8), 0], atol=1e-12)
    for_graph = kept.for_graph(np.eye(4), np.eye(6), turned)
    np.testing.assert_allclose(for_graph.direction[0], [np.cos(0.3), np.sin(0.3), 0], atol=1e-12)
    np.testing.assert_allclose(for_graph.direction_covariance[0] @ for_graph.direction[0], 0, atol=1e-12)
    assert (for_graph.robot_a, for_graph.robot_b, len(for_graph)) == ("a", "b", 1)
