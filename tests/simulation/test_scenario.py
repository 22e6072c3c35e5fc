"""A mission: the same scans whenever they are read, true poses, radio, no way through walls."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from wiclosure.errors import ConfigError
from wiclosure.interfaces import ScanSource
from wiclosure.simulation import Scenario, ScenarioSettings, make_scenario
from wiclosure.simulation.world.motion import MotionSettings, drive


@pytest.fixture(scope="module")
def demo_site() -> Scenario:
    return make_scenario("demo-site")


def test_scans_are_the_same_whenever_they_are_read(demo_site: Scenario) -> None:
    source = demo_site.scan_source("alpha")
    assert isinstance(source, ScanSource)
    first, again = list(islice(source, 3)), list(islice(source, 3))
    other = next(iter(make_scenario("demo-site").scan_source("alpha")))
    for a, b in zip([*first, first[0]], [*again, other], strict=True):
        assert a.stamp_ns == b.stamp_ns
        np.testing.assert_array_equal(a.points, b.points)
        np.testing.assert_array_equal(a.times, b.times)
    assert not np.array_equal(first[0].points[:100], next(iter(demo_site.scan_source("beta"))).points[:100])


def test_scans_of_one_robot_differ_in_noise_with_the_seed(demo_site: Scenario) -> None:
    other = make_scenario("demo-site", ScenarioSettings(seed=1))
    a, b = (next(iter(scenario.scan_source("alpha"))) for scenario in (demo_site, other))
    assert a.points.shape != b.points.shape or not np.allclose(a.points, b.points)


def test_radio_is_deterministic_and_mentions_the_robots(demo_site: Scenario) -> None:
    log = demo_site.wireless()
    assert log == make_scenario("demo-site").wireless()
    assert log.robots() == {"alpha", "beta"}
    assert len(log.measurements) >= 15


def test_scan_stamps_lie_on_the_ground_truth(demo_site: Scenario) -> None:
    truth, source = demo_site.ground_truth("beta"), demo_site.scan_source("beta")
    assert len(truth) == len(source) + 1
    assert [scan.stamp_ns for scan in islice(source, 2)] == truth.stamps_ns[:2].tolist()


def test_a_drive_through_a_wall_is_refused(demo_site: Scenario) -> None:
    ground = demo_site.scene.ground
    motion = drive(np.array([[-28.0, 0.0], [0.0, -1.0]]), ground, MotionSettings())
    with pytest.raises(ConfigError, match=r"robot alpha runs into something near \(-2[12]"):
        Scenario("broken", demo_site.scene, {"alpha": motion}, demo_site.lidar, demo_site.radio)
