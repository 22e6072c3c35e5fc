"""What a run reads."""

from __future__ import annotations

from dataclasses import dataclass

from wiclosure.interfaces import ScanSource
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
