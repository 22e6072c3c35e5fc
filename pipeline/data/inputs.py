"""What a run reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from wiclosure.interfaces import ScanSource
from wiclosure.types import FloatArray, GnssLog, ImuLog, Trajectory, WirelessLog


@dataclass(frozen=True, slots=True, eq=False)
class ImuInput:
    """One robot's inertial measurements.

    Args:
        log: in the IMU's axes and the clock of the scans.
        T_lidar_imu: `(4, 4)` mounting, or None where it is to be found.
    """

    log: ImuLog
    T_lidar_imu: FloatArray | None = None


@dataclass(frozen=True, slots=True, eq=False)
class GnssInput:
    """One robot's positions on the Earth.

    Args:
        log: in the clock of the scans.
        antenna_lidar: `(3,)` the antenna in the LiDAR's frame, m.
    """

    log: GnssLog
    antenna_lidar: FloatArray


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
        odometry_origin_m: `(3,)` where that odometry frame's origin was moved to, so that numbers stay small.
        elevation_correction_deg: what the sensor's calibration needs, where nothing else is set.
        odometry_settings: settings of odometry that are this robot's own, by name.
        remarks: sentences on what is not used, and why.
        imu: its inertial measurements, or None.
        gnss: its positions on the Earth, or None.
    """

    robot: str
    scans: ScanSource
    identity: object
    ground_truth: Trajectory | None
    salvaged: bool = False
    odometry: Trajectory | None = None
    odometry_origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    elevation_correction_deg: float = 0.0
    odometry_settings: Mapping[str, object] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    imu: ImuInput | None = None
    gnss: GnssInput | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Inputs:
    """Everything that one run reads.

    Args:
        robots: their recordings.
        wireless: what they heard of each other.
        limit: how many scans of each robot are read at most, or None.
    """

    robots: tuple[RobotInput, ...]
    wireless: WirelessLog
    limit: int | None = None

    @property
    def ground_truth(self) -> dict[str, Trajectory]:
        """Ground truth of the robots that have it."""
        return {r.robot: r.ground_truth for r in self.robots if r.ground_truth is not None}
