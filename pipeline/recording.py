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
    """

    scans: Path
    topic: str | None = None
    ground_truth: Path | None = None
    time_offset: float = 0.0
    ranges: Mapping[str, str] = field(default_factory=dict)

    @property
    def time_offset_ns(self) -> int:
        """The time offset in nanoseconds."""
        return round(self.time_offset * 1e9)
