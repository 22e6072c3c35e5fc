"""Trajectories that words of a command line name: `alpha=alpha.tum`."""

from __future__ import annotations

from collections.abc import Sequence

from wiclosure.drift import DriftModel
from wiclosure.errors import ConfigError
from wiclosure.formats.trajectories.trajectory_file import read_trajectory
from wiclosure.types import Trajectory


def named_trajectories(words: Sequence[str], drift: DriftModel | None = None) -> dict[str, Trajectory]:
    """The trajectory of each robot.

    Raises:
        InputError: a file cannot be read.
        ConfigError: a word of another form, a robot twice, or fewer than two.
    """
    robots: dict[str, Trajectory] = {}
    for word in words:
        robot, equals, path = word.partition("=")
        if not (robot and equals and path):
            raise ConfigError(f"--trajectory {word}: expected NAME=FILE, for example alpha=alpha.tum")
        if robot in robots:
            raise ConfigError(f"--trajectory names {robot} twice; give each robot a name of its own")
        robots[robot] = read_trajectory(path, robot, drift)
    if len(robots) < 2:
        raise ConfigError("one trajectory only: there is nothing to compare; give --trajectory for each robot")
    return robots
