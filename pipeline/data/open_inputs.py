"""Opens what the user names, data set or scenario, and checks it before any work is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from wiclosure.errors import ConfigError
from wiclosure.pipeline.data.dataset import load_dataset
from wiclosure.pipeline.data.inputs import Inputs, RobotInput
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.runtime.cache import file_identity


def open_inputs(
    data: Sequence[str],
    *,
    topic: str | None = None,
    wireless: Sequence[Path] = (),
    limit: int | None = None,
    salvage: bool = False,
) -> Inputs:
    """Opens everything that the user names, so that what is wrong shows before the long work starts.

    Args:
        data: one `dataset.yaml`, recordings as `alpha=path`, or one `scenario:NAME` (see `scenario_source`).
        topic: PointCloud2 topic of all bags, whatever the data set states.
        wireless: wireless logs besides those of the data set.
        limit: read at most so many scans per robot.
        salvage: use what can be read of damaged bags.

    Raises:
        InputError: something is missing, malformed, or does not belong together.
        ConfigError: a scenario with impossible settings, or beside other data.
    """
    if any(word.startswith("scenario:") for word in data):
        if len(data) > 1 or topic or wireless or salvage:
            raise ConfigError(
                f"{' '.join(data)}: a scenario stands alone, with its own radio; leave other data, --topic, --wireless"
                " and --salvage out"
            )
        # Imported here: it needs scipy's splines, which recordings do not.
        from wiclosure.pipeline.data.scenario_source import read_scenario_word, scenario_inputs

        return scenario_inputs(*read_scenario_word(data[0]), limit=limit)
    dataset = load_dataset(data, topic=topic, wireless=wireless)
    robots = tuple(
        RobotInput(
            robot=robot,
            scans=dataset.scans(robot, limit=limit, salvage=salvage),
            identity=_identity(recording, limit, salvage=salvage),
            ground_truth=dataset.ground_truth(robot, salvage=salvage),
            salvaged=salvage,
            odometry=dataset.odometry(robot, salvage=salvage),
        )
        for robot, recording in dataset.robots.items()
    )
    return Inputs(robots, dataset.wireless_log(salvage=salvage))


def _identity(recording: RobotRecording, limit: int | None, *, salvage: bool) -> list[object]:
    """All that the scans and the odometry depend on."""
    return [
        file_identity(recording.scans),
        recording.topic,
        recording.time_offset_ns,
        limit,
        salvage,
        None if recording.odometry is None else file_identity(recording.odometry),
        recording.odometry_topic,
        recording.lidar_pose,
    ]
