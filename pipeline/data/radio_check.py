"""A radio log and trajectories to hold it against, from what the user names."""

from __future__ import annotations

from collections.abc import Sequence

from wiclosure.errors import ConfigError, InputError
from wiclosure.pipeline.data.dataset import load_dataset
from wiclosure.pipeline.data.folders.survey import is_recording, survey_file
from wiclosure.pipeline.data.named_trajectories import named_trajectories
from wiclosure.pipeline.radio.read import read_radio
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.runtime.paths import expanded, is_file
from wiclosure.types import Trajectory, WirelessLog


def log_and_trajectories(
    data: Sequence[str], sources: Sequence[RadioSource], trajectories: Sequence[str], *, salvage: bool = False
) -> tuple[WirelessLog, dict[str, Trajectory], RadioSource | None]:
    """Radio and paths of a data set, or of sources and `NAME=FILE` words; the source, where there is only one.

    Of a data set each robot's own odometry serves, else its ground truth; `trajectories` replace them.

    Raises:
        InputError: something cannot be read, or the log holds no measurement with two of the robots.
        ConfigError: nothing to check, or a robot without a trajectory.
    """
    if data:
        _require_no_log(data)
        dataset = load_dataset(data, wireless=sources)
        named = named_trajectories(trajectories) if trajectories else {}
        for robot in dataset.robots:
            path = named.get(robot) or dataset.odometry(robot, salvage=salvage) or dataset.ground_truth(robot)
            if path is None:
                raise ConfigError(
                    f"{robot} has neither odometry nor ground_truth to check the radio with; give --trajectory"
                    f" {robot}=FILE, as {robot}_odometry.tum of a run's folder (a radio log: --wireless FILE)"
                )
            named[robot] = path
        return dataset.wireless_log(salvage=salvage), named, _only(dataset.wireless)
    if not sources:
        raise ConfigError("nothing to check: give a data set, or a log with --wireless and trajectories")
    named = named_trajectories(trajectories)
    log, left = WirelessLog(), []
    for source in sources:
        reading = read_radio(source, named, salvage=salvage)
        log += reading.log
        left += [] if reading.account is None else reading.account.sentences()
    if not log.measurements:
        raise InputError("; ".join(left) or "the log holds no measurements")
    return log, named, _only(sources)


def _only(sources: Sequence[RadioSource]) -> RadioSource | None:
    return sources[0] if len(sources) == 1 else None


def _require_no_log(data: Sequence[str]) -> None:
    for word in data:
        path = expanded(word)
        if is_file(path) and not is_recording(path) and survey_file(path).kind == "radio":
            raise ConfigError(
                f"{word} is a radio log, no data set; name it with --wireless {word}, and each robot's trajectory with"
                " --trajectory NAME=FILE"
            )
