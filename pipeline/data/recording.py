"""Where one robot's recording is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True, slots=True)
class RobotRecording:
    """One robot of a data set.

    Args:
        scans: bag, KITTI folder or folder of clouds.
        topic: PointCloud2 topic; None takes the only one.
        ground_truth: TUM file of `T_world_body`, or None.
        time_offset: seconds to add to every stamp of this robot: scans, ground truth and radio.
        ranges: transmitter of each `sensor_msgs/Range` topic in the robot's bag that is a radio's.
        odometry: TUM file of the robot's own odometry, in the place of KISS-ICP's, or None.
        odometry_topic: the same as a `nav_msgs/Odometry` topic of its bag.
        lidar_pose: `x y z qx qy qz qw` of the LiDAR in the body frame of that odometry; None: they are the same.
    """

    scans: Path
    topic: str | None = None
    ground_truth: Path | None = None
    time_offset: float = 0.0
    ranges: Mapping[str, str] = field(default_factory=dict)
    odometry: Path | None = None
    odometry_topic: str | None = None
    lidar_pose: tuple[float, ...] | None = None

    @property
    def time_offset_ns(self) -> int:
        """The time offset in nanoseconds."""
        return round(self.time_offset * 1e9)
