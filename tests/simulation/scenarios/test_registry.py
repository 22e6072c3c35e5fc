"""The registry of scenarios: all can be driven, and choices that make no sense are refused."""

from __future__ import annotations

import pytest

from wiclosure.errors import ConfigError
from wiclosure.simulation import ScenarioSettings, make_scenario


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
        make_scenario(name, ScenarioSettings.model_validate(changes))


@pytest.mark.parametrize("name", ["shell-space", "city", "campus", "static-mirror"])
def test_every_robot_sees_and_hears(name: str) -> None:
    scenario = make_scenario(name)
    for robot in scenario.robots:
        assert len(next(iter(scenario.scan_source(robot))).points) > 3_000
    assert len(scenario.wireless().measurements) >= 4
