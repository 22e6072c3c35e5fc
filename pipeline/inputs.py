"""What a run reads, opened and checked before any work is done."""

from __future__ import annotations

import logging
from dataclasses import dataclass

from wiclosure.interfaces import ScanSource
from wiclosure.types import Trajectory, WirelessLog

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, eq=False)
class RobotInput:
    """One robot's recording.

    Args:
        robot: its name.
        scans: where they are read from.
        identity: what tells this recording from any other and from its changed self.
        ground_truth: `T_world_body`, one world for all robots, or None.
    """

    robot: str
    scans: ScanSource
    identity: object
    ground_truth: Trajectory | None


@dataclass(frozen=True, slots=True, eq=False)
class Inputs:
    """Everything that one run reads."""

    robots: tuple[RobotInput, ...]
    wireless: WirelessLog

    @property
    def ground_truth(self) -> dict[str, Trajectory]:
        """Ground truth of the robots that have it."""
        return {r.robot: r.ground_truth for r in self.robots if r.ground_truth is not None}
