"""What a run reads, opened and checked before any work is done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from wiclosure.errors import ConfigError
from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.data.dataset import load_dataset
from wiclosure.pipeline.runtime.cache import file_identity
from wiclosure.types import Trajectory, WirelessLog


@dataclass(frozen=True, slots=True, eq=False)
class RobotInput:
    """One robot's recording.

    Args:
        robot: its name.
        scans: where they are read from.
        identity: what tells this recording from any other and from its changed self.
        ground_truth: `T_world_body`, one world for all robots, or None.
        salvaged: whether what is damaged is read as far as it goes.
        odometry: the robot's own `T_odom_body`, in the place of KISS-ICP's, or None.
    """

    robot: str
    scans: ScanSource
    identity: object
    ground_truth: Trajectory | None
    salvaged: bool = False
    odometry: Trajectory | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Inputs:
    """Everything that one run reads."""

    robots: tuple[RobotInput, ...]
    wireless: WirelessLog

    @property
    def ground_truth(self) -> dict[str, Trajectory]:
        """Ground truth of the robots that have it."""
        return {r.robot: r.ground_truth for r in self.robots if r.ground_truth is not None}


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
        limit: read at most so many scans a robot.
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
        return _simulated(data[0], limit)
    dataset = load_dataset(data, topic=topic, wireless=wireless)
    robots = tuple(
        RobotInput(
            robot=robot,
            scans=dataset.scans(robot, limit=limit, salvage=salvage),
            identity=[
                file_identity(recording.scans),
                recording.topic,
                recording.time_offset_ns,
                limit,
                salvage,
                None if recording.odometry is None else file_identity(recording.odometry),
                recording.odometry_topic,
                recording.lidar_pose,
            ],
            ground_truth=dataset.ground_truth(robot, salvage=salvage),
            salvaged=salvage,
            odometry=dataset.odometry(robot, salvage=salvage),
        )
        for robot, recording in dataset.robots.items()
    )
    return Inputs(robots, dataset.wireless_log(salvage=salvage))


def _simulated(word: str, limit: int | None) -> Inputs:
    # Imported here: it makes these inputs, and needs scipy's splines, which recordings do not.
    from wiclosure.pipeline.data.scenario_source import read_scenario_word, scenario_inputs

    name, settings = read_scenario_word(word)
    return scenario_inputs(name, settings, limit=limit)
