"""Where one robot's recording is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from wiclosure.formats.radio.radio_units import LengthUnit


@dataclass(frozen=True, slots=True)
class RobotRecording:
    """One robot of a data set.

    Args:
        scans: bag, KITTI folder or folder of clouds.
        topic: PointCloud2 topic; None takes the only one.
        layout: fields of the records in a folder's `.bin` files (see `wiclosure.pipeline.sources.clouds.bin`).
        scan_unit: unit of the coordinates in the clouds; None: metres, which is looked at.
        ground_truth: file (TUM, EuRoC, KITTI poses) or bag of `T_world_body`, or None.
        ground_truth_topic: its topic, where it is in a bag: the one named, or that of the scans.
        time_offset: seconds to add to every stamp of this robot: scans, ground truth and radio.
        ranges: transmitter of each `sensor_msgs/Range` topic in the robot's bag that is a radio's.
        ignored_radio: topics of the robot's bag that are radio and are left out.
        odometry: file (TUM, EuRoC) or bag of the robot's own odometry, in the place of KISS-ICP's, or None.
        odometry_topic: its topic, where it is in a bag: the one named, or that of the scans.
        odometry_settings: settings of odometry that are this robot's own, by name.
        imu: bag, table or OXTS folder with the robot's inertial measurements; None: the bag or drive of the scans.
        imu_topic: its topic, where it is in a bag; None takes the only one.
        imu_pose: `x y z qx qy qz qw` of the IMU in the LiDAR's frame; None: found.
        imu_units: of acceleration and turning rate.
        imu_time_offset: seconds to add to the IMU's stamps, besides `time_offset`.
        gnss: bag, table or OXTS folder with positions on the Earth, or None.
        gnss_topic: its topic: in the bag named, or that of the scans.
        gnss_antenna: `x y z` of the antenna in the LiDAR's frame.
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
    layout: str | None = None
    scan_unit: LengthUnit | None = None
    ground_truth_topic: str | None = None
    odometry_settings: Mapping[str, object] = field(default_factory=dict)
    imu: Path | None = None
    imu_topic: str | None = None
    imu_pose: tuple[float, ...] | None = None
    imu_units: tuple[str, ...] | None = None
    imu_time_offset: float = 0.0
    gnss: Path | None = None
    gnss_topic: str | None = None
    gnss_antenna: tuple[float, ...] | None = None
    ignored_radio: tuple[str, ...] = ()

    @property
    def time_offset_ns(self) -> int:
        """The time offset in nanoseconds."""
        return round(self.time_offset * 1e9)
