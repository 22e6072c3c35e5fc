"""The registered scenarios: deterministic, drivable, and refused where they make no sense."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest

from wiclosure.errors import ConfigError
from wiclosure.interfaces import ScanSource
from wiclosure.simulation import Scenario, ScenarioSettings, make_scenario


def settings(**changes: object) -> ScenarioSettings:
    return ScenarioSettings.model_validate(changes)


@pytest.fixture(scope="module")
def demo_site() -> Scenario:
    return make_scenario("demo-site")


def test_demo_site_is_short_and_its_robots_meet(demo_site: Scenario) -> None:
    alpha, beta = (demo_site.ground_truth(robot) for robot in ("alpha", "beta"))
    assert all(len(demo_site.scan_source(robot)) < 220 for robot in demo_site.robots)
    assert alpha.distance[-1] > 90
    assert beta.distance[-1] > 90
    apart = np.linalg.norm(alpha.positions[:, None] - beta.positions[None], axis=2)
    middle = alpha.positions[:, 1] > -5
    assert apart[middle].min() < 9
    assert apart[~middle].min() < 2


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
    other = make_scenario("demo-site", settings(seed=1))
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


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("demosite", {}, "did you mean demo-site"),
        ("demo-site", {"robots": 0}, "0 robots"),
        ("demo-site", {"robots": 3}, "1 to 2"),
        ("demo-site", {"lidar": "hdl-64"}, "did you mean hdl64"),
        ("demo-site", {"lidar_max_range_m": 0.1}, "range is cut"),
    ],
)
def test_impossible_choices_are_refused_with_the_way_out(name: str, changes: dict[str, object], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        make_scenario(name, settings(**changes))
