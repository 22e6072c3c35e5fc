"""`scenario:NAME` as data: a simulated world whose rays are cast while the run reads them.

Settings follow the name, separated by commas: `scenario:kitti08,poses=08.txt,robots=3,radio.every_m=20`.  Commas need
no quotes in any shell.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from pydantic import ValidationError

from wiclosure.errors import ConfigError
from wiclosure.pipeline.data.inputs import GnssInput, ImuInput, Inputs, RobotInput
from wiclosure.pipeline.runtime.cache import code_digest, file_identity
from wiclosure.pipeline.runtime.settings_text import explain, nested_words
from wiclosure.simulation.scenario import Scenario
from wiclosure.simulation.scenarios.registry import ScenarioSettings, make_scenario

PREFIX = "scenario:"


def read_scenario_word(word: str) -> tuple[str, ScenarioSettings]:
    """Name and settings of a word like `scenario:city,seed=3`; the prefix may be missing.

    Raises:
        ConfigError: a setting that does not exist (with a near one) or cannot be.
    """
    name, *settings = word.removeprefix(PREFIX).split(",")
    return name, scenario_settings(settings, PREFIX + name)


def scenario_settings(words: Sequence[str], place: str) -> ScenarioSettings:
    """Settings of `key=value` words; `place` is where they stand, for messages.

    Raises:
        ConfigError: see `read_scenario_word`.
    """
    try:
        return ScenarioSettings.model_validate(nested_words(words, place))
    except ValidationError as error:
        raise ConfigError(explain(error, place, ScenarioSettings)) from None


def scenario_inputs(name: str, settings: ScenarioSettings | None = None, *, limit: int | None = None) -> Inputs:
    """A simulated world as a run reads it: what `wiclosure simulate` would write, without the disk.

    Args:
        name: of the scenario.
        settings: what is chosen about it; for another seed, `settings.model_copy(update={"seed": seed})`.
        limit: read at most so many scans per robot.

    Raises:
        ConfigError: unknown scenario or LiDAR, or settings that make no sense.
        InputError: a poses or schedule file cannot be read.
    """
    settings = settings or ScenarioSettings()
    scenario = make_scenario(name, settings)
    identity = _identity(name, settings, limit)
    robots = tuple(_robot_input(scenario, robot, identity, limit) for robot in scenario.robots)
    return Inputs(robots, scenario.wireless(), limit)


def _robot_input(scenario: Scenario, robot: str, identity: object, limit: int | None) -> RobotInput:
    scans = scenario.scan_source(robot)
    if limit is not None:
        scans = replace(scans, scans=min(limit, len(scans)))
    imu, gnss = scenario.imu_log(robot), scenario.gnss_log(robot)
    return RobotInput(
        robot, scans, identity, scenario.ground_truth(robot),
        imu=None if imu is None or scenario.imu is None else ImuInput(imu, scenario.imu.T_lidar_imu()),
        gnss=None if gnss is None or scenario.gnss is None else GnssInput(gnss, scenario.gnss.antenna_lidar()),
    )  # fmt: skip


def _identity(name: str, settings: ScenarioSettings, limit: int | None) -> list[object]:
    """All that the scans depend on.  The radio is none of it: odometry is shared by runs that hear differently."""
    chosen = settings.model_dump(mode="json", exclude={"radio", "schedule", "imu", "gnss"})
    poses = None if settings.poses is None else file_identity(settings.poses)
    return [PREFIX, name, chosen, poses, limit, code_digest(("wiclosure.simulation",))]
