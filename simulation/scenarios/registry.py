"""The scenarios by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from pydantic import Field

from wiclosure.errors import ConfigError
from wiclosure.settings import Settings
from wiclosure.simulation.names import lookup
from wiclosure.simulation.scenario import Scenario
from wiclosure.simulation.scenarios import campus, city, demo_site, kitti_streets, shell_space, static_mirror
from wiclosure.simulation.sensors.gnss import GnssSettings
from wiclosure.simulation.sensors.imu import ImuSettings
from wiclosure.simulation.sensors.lidar import LidarModel, lidar_model
from wiclosure.simulation.sensors.radio import RadioSettings
from wiclosure.simulation.sensors.schedule import read_schedule
from wiclosure.simulation.world.motion import Motion
from wiclosure.simulation.world.scene import Scene
from wiclosure.simulation.world.traffic import Traffic, TrafficSettings


class ScenarioSettings(Settings):
    """What can be chosen about a scenario; None leaves the scenario's own value."""

    seed: int = Field(0, ge=0, description="of the scene's details and of all noise")
    robots: int | None = Field(None, description="how many")
    lidar: str | None = Field(None, description="model: hdl64, vlp16, vlp32, os1-64, generic-32")
    lidar_max_range_m: float | None = Field(None, gt=0, description="m, cuts the LiDAR's range")
    lidar_range_sigma_m: float | None = Field(None, ge=0, description="m, range noise")
    lidar_dropout: float | None = Field(None, ge=0, lt=1, description="share of returns lost")
    aliasing: float | None = Field(None, ge=0, le=1, description="0: every house or pillar is unique; 1: all are alike")
    poses: Path | None = Field(None, description="KITTI poses file to build streets along (kitti08)")
    schedule: Path | None = Field(None, description="CSV file of the times when robots can talk (read_schedule)")
    radio: RadioSettings = Field(RadioSettings(), description="what is set here replaces the scenario's own value")
    imu: ImuSettings | None = Field(None, description="an IMU on every robot, where any of it is set")
    traffic: TrafficSettings | None = Field(None, description="cars and people that move, where any of it is set")
    gnss: GnssSettings | None = Field(None, description="a satellite receiver on every robot, where any of it is set")


@dataclass(frozen=True)
class ScenarioKind:
    """One entry of the registry: what is built by default, and how.

    Args:
        summary: one line for the user.
        robots: default and largest number.
        lidar: model by default.
        aliasing: by default.
        radio: by default.
        build: makes the scenario of the resolved choice.
    """

    summary: str
    robots: tuple[int, int]
    lidar: LidarModel
    aliasing: float
    radio: RadioSettings
    build: Callable[[Choice], Scenario]


@dataclass(frozen=True)
class Choice:
    """Everything settled that a builder needs."""

    name: str
    seed: int
    robots: int
    lidar: LidarModel
    aliasing: float
    radio: RadioSettings
    poses: Path | None

    def rng(self) -> np.random.Generator:
        """Randomness for the scene, apart from that of the noise."""
        return np.random.default_rng([self.seed, 0])


def make_scenario(name: str, settings: ScenarioSettings | None = None) -> Scenario:
    """The scenario of that name.

    Raises:
        ConfigError: unknown scenario or LiDAR (with a suggestion), or settings that make no sense.
    """
    kind = lookup("scenario", name, SCENARIOS)
    settings = settings or ScenarioSettings()
    robots = kind.robots[0] if settings.robots is None else settings.robots
    if not 1 <= robots <= kind.robots[1]:
        raise ConfigError(f"{robots} robots asked for; scenario {name} has room for 1 to {kind.robots[1]}")
    scenario = kind.build(
        Choice(
            name,
            settings.seed,
            robots,
            _lidar(kind, settings),
            _first(settings.aliasing, kind.aliasing),
            _radio(kind, settings),
            settings.poses,
        )
    )
    traffic = None
    if settings.traffic is not None:
        traffic = Traffic.along(scenario.robots, scenario.scene, settings.traffic, settings.seed)
    scenario = replace(scenario, imu=settings.imu, gnss=settings.gnss, traffic=traffic)
    for robot in {end for window in scenario.radio.schedule or () for end in (window.robot_a, window.robot_b) if end}:
        lookup("robot", robot, scenario.robots)
    return scenario


def _lidar(kind: ScenarioKind, settings: ScenarioSettings) -> LidarModel:
    """The chosen model; another model keeps the scenario's rate and range cut."""
    model = kind.lidar
    if settings.lidar is not None:
        wanted = lidar_model(settings.lidar)
        cut_m = min(wanted.max_range_m, model.max_range_m)
        model = replace(wanted, rate_hz=model.rate_hz, max_range_m=cut_m)
    return replace(
        model,
        max_range_m=_first(settings.lidar_max_range_m, model.max_range_m),
        range_sigma_m=_first(settings.lidar_range_sigma_m, model.range_sigma_m),
        dropout=_first(settings.lidar_dropout, model.dropout),
    )


def _radio(kind: ScenarioKind, settings: ScenarioSettings) -> RadioSettings:
    """The scenario's own, single fields replaced by those that are set."""
    changes = settings.radio.model_dump(exclude_unset=True)
    if settings.schedule is not None:
        changes["schedule"] = read_schedule(settings.schedule)
    return RadioSettings.model_validate(kind.radio.model_dump() | changes)


def _first(chosen: float | None, default: float) -> float:
    return default if chosen is None else chosen


def _demo_site(choice: Choice) -> Scenario:
    scene = demo_site.scene(choice.rng(), choice.aliasing)
    return _of(choice, scene, demo_site.robots(scene, choice.robots))


def _shell_space(choice: Choice) -> Scenario:
    scene = shell_space.scene(choice.rng(), choice.aliasing)
    return _of(choice, scene, shell_space.robots(scene, choice.robots))


def _city(choice: Choice) -> Scenario:
    scene = city.scene(choice.rng(), choice.aliasing)
    return _of(choice, scene, city.robots(scene, choice.robots))


def _kitti08(choice: Choice) -> Scenario:
    if choice.poses is None:
        raise ConfigError(
            f"scenario {choice.name} builds its streets along a recorded trajectory; name a KITTI poses file:"
            f" simulate {choice.name} --poses FILE, or scenario:{choice.name},poses=FILE"
        )
    xy_m, yaw_rad = kitti_streets.read_positions(choice.poses)
    scene = kitti_streets.scene(xy_m, choice.rng(), choice.aliasing)
    return _of(choice, scene, kitti_streets.robots(xy_m, yaw_rad, scene, choice.robots))


def _campus(choice: Choice) -> Scenario:
    scene = campus.scene(choice.rng(), choice.robots, choice.aliasing)
    return _of(choice, scene, campus.robots(scene, choice.robots))


def _static_mirror(choice: Choice) -> Scenario:
    scene = static_mirror.scene(choice.rng())
    return _of(choice, scene, static_mirror.robots(scene, choice.robots))


def _of(choice: Choice, scene: Scene, robots: dict[str, Motion]) -> Scenario:
    return Scenario(choice.name, scene, robots, choice.lidar, choice.radio, choice.seed)


SCENARIOS: dict[str, ScenarioKind] = {
    "demo-site": ScenarioKind(
        "two vehicles on a small works yard with two look-alike halls",
        (2, 2),
        demo_site.lidar(lidar_model("generic-32")),
        1.0,
        RadioSettings.model_validate({"every_m": 4.0, "range_sigma_m": 0.3, "paths": 4}),
        _demo_site,
    ),
    "shell-space": ScenarioKind(
        "two robots in an empty storey with a grid of identical pillars, after the paper's hardware experiment",
        (2, 2),
        shell_space.lidar(lidar_model("vlp16")),
        1.0,
        # The paper's robots carry an AHRS: 0.8 degrees by its data sheet, several times that between steel pillars.
        RadioSettings.model_validate(
            {"every_m": 10.0, "range_sigma_m": 0.3, "paths": 5, "dropout": 0.0, "heading_sigma_deg": 5.0}
        ),
        _shell_space,
    ),
    "city": ScenarioKind(
        "cars in a few blocks of streets with rows of houses, some of them alike",
        (2, 3),
        lidar_model("os1-64"),
        0.5,
        RadioSettings.model_validate({"every_m": 10.0}),
        _city,
    ),
    "kitti08": ScenarioKind(
        "streets along a recorded trajectory, driven in three parts at once, after the paper's simulation",
        (3, 8),
        lidar_model("hdl64"),
        0.5,
        RadioSettings.model_validate({"every_m": 10.0, "paths": 5, "blocked_range": 1.0}),
        _kitti08,
    ),
    "campus": ScenarioKind(
        "robots around large buildings; neighbours share a walkway, others never meet",
        (5, 8),
        campus.lidar(lidar_model("generic-32")),
        0.3,
        RadioSettings.model_validate({"every_m": 10.0}),
        _campus,
    ),
    "static-mirror": ScenarioKind(
        "two robots that hardly move, the direct way blocked, a wall mirroring: for tests",
        (2, 2),
        lidar_model("vlp16"),
        1.0,
        RadioSettings.model_validate(
            {
                "every_m": None,
                "every_s": 2.0,
                "paths": 1,
                "direct_absent_blocked": 1.0,
                "blocked_range": 1.0,
                "dropout": 0.0,
            }
        ),
        _static_mirror,
    ),
}
