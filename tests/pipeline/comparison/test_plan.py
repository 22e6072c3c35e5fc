"""Arms and the worlds in which they run."""

from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.errors import ConfigError
from wiclosure.pipeline.comparison.plan import Plan, World, recorded_worlds, require_each_once, scenario_worlds
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.inputs import Inputs
from wiclosure.simulation.scenarios.registry import ScenarioSettings
from wiclosure.types import WirelessLog

NOTHING = Inputs((), WirelessLog())


def world(*draws: int) -> World:
    return World(draws[0], lambda: NOTHING, draws)


@pytest.mark.parametrize(
    ("presets", "worlds", "folder"),
    [
        (["strong"], [world(0)], ""),
        (["strong", "loose"], [world(0)], "strong"),
        (["strong"], [world(0), world(1)], "seed-1"),
        (["strong"], [world(0, 1)], "seed-1"),
        (["strong", "loose"], [world(0), world(1)], "seed-1/strong"),
    ],
)
def test_folders_have_only_the_levels_that_tell_runs_apart(
    presets: list[str], worlds: list[World], folder: str
) -> None:
    plan = Plan(dict.fromkeys(presets, Config()), ("none",), tuple(worlds))
    assert plan.folder(1, "strong") == Path(folder)


@pytest.mark.parametrize(
    ("filters", "message"),
    [((), "nothing to compare"), (("magic",), "unknown candidate filter 'magic'"), (("none", "none"), "named twice")],
)
def test_plans_that_cannot_run_are_refused(filters: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Plan({"strong": Config()}, filters, ())


def test_only_the_random_filter_runs_over_recordings_with_every_seed() -> None:
    (only,), remarks = recorded_worlds(lambda: NOTHING, ["none"], 3, 5)
    assert (only.seed, only.draws, only.inputs()) == (5, (5,), NOTHING)
    assert remarks == (
        "recordings are one world: of 3 seeds only the random filter is another each time, and that is not among the"
        " filters: one run each",
    )
    (only,), remarks = recorded_worlds(lambda: NOTHING, ["none", "random"], 3, 5)
    assert only.draws == (5, 6, 7)
    assert "so the other filters run once" in remarks[0]
    assert recorded_worlds(lambda: NOTHING, ["random"])[1] == ()


def test_worlds_of_a_scenario_follow_its_seed() -> None:
    worlds = scenario_worlds("demo-site", ScenarioSettings(seed=4, lidar="vlp16"), 2, limit=3)
    assert [(w.seed, w.draws) for w in worlds] == [(4, (4,)), (5, (5,))]
    first, second = (w.inputs() for w in worlds)
    assert [len(robot.scans) for robot in first.robots] == [3, 3]
    assert first.wireless != second.wireless


def test_names_that_stand_twice_are_named() -> None:
    require_each_once("preset", ["a", "b"])
    with pytest.raises(ConfigError, match="preset a, b is named twice; name each once"):
        require_each_once("preset", ["b", "a", "b", "a"])
