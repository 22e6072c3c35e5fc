"""What a run reads, opened and checked before any work is done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.cache import file_identity
from wiclosure.pipeline.dataset import load_dataset
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
    """

    robot: str
    scans: ScanSource
    identity: object
    ground_truth: Trajectory | None
    salvaged: bool = False


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
        data: one `dataset.yaml`, or recordings as `alpha=path`.
        topic: PointCloud2 topic of all bags, whatever the data set states.
        wireless: wireless logs besides those of the data set.
        limit: read at most so many scans a robot.
        salvage: use what can be read of damaged bags.

    Raises:
        InputError: something is missing, malformed, or does not belong together.
    """
    dataset = load_dataset(data, topic=topic, wireless=wireless)
    robots = tuple(
        RobotInput(
            robot=robot,
            scans=dataset.scans(robot, limit=limit, salvage=salvage),
            identity=[file_identity(recording.scans), recording.topic, recording.time_offset_ns, limit, salvage],
            ground_truth=dataset.ground_truth(robot, salvage=salvage),
            salvaged=salvage,
        )
        for robot, recording in dataset.robots.items()
    )
    return Inputs(robots, dataset.wireless_log(salvage=salvage))
