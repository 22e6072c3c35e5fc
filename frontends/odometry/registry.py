"""All kinds of odometry by name; each follows one sensor through its scans (`wiclosure.interfaces.Odometry`)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

from wiclosure.errors import ConfigError
from wiclosure.frontends.config import OdometrySettings
from wiclosure.interfaces import Odometry
from wiclosure.types import Trajectory

OdometryFactory: TypeAlias = Callable[[OdometrySettings, Trajectory | None], Odometry]
"""Takes the settings, and the odometry that the robot brings along, if any: `T_odom_lidar` on the scans' clock."""


def _make_kiss(settings: OdometrySettings, recorded: Trajectory | None) -> Odometry:
    # Imported here: a robot that brings its own odometry needs no kiss-icp.
    from wiclosure.frontends.odometry.kiss_odometry import KissOdometry

    return KissOdometry(settings)


def _make_recorded(settings: OdometrySettings, recorded: Trajectory | None) -> Odometry:
    from wiclosure.frontends.odometry.recorded_odometry import RecordedOdometry

    if recorded is None:
        raise ConfigError("recorded odometry needs a trajectory; name the robot's own, or take kiss-icp")
    return RecordedOdometry(settings, recorded)


ODOMETRIES: Mapping[str, OdometryFactory] = {
    "kiss-icp": _make_kiss,
    "recorded": _make_recorded,
}


def make_odometry(settings: OdometrySettings, recorded: Trajectory | None = None) -> Odometry:
    """The odometry that `settings.source` names; a robot that brings none is followed by KISS-ICP.

    Args:
        settings: of odometry.
        recorded: `T_odom_lidar` that the robot brings along, on the scans' clock, or None.
    """
    source = "kiss-icp" if settings.source == "recorded" and recorded is None else settings.source
    return ODOMETRIES[source](settings, recorded)
