"""Odometry that the robot brings along (wheels, LIO-SAM, FAST-LIO ...) in the place of KISS-ICP's."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.deskewing import deskewed
from wiclosure.frontends.keyframes import thinned
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.types import Float32Array, FloatArray, Scan, Trajectory


class RecordedOdometry:
    """Poses from a trajectory; scans are deskewed along it and thinned as KISS-ICP's are.

    Args:
        settings: ranges, voxel and deskewing count here too.
        trajectory: `T_odom_body` of the LiDAR's frame, on the scans' clock.
    """

    def __init__(self, settings: OdometrySettings, trajectory: Trajectory) -> None:
        self._settings = settings
        self._trajectory = trajectory
        self.voxel_size_m = settings.voxel_size_m or float("nan")
        self._points = np.zeros((0, 3))

    def register(self, scan: Scan) -> tuple[int, FloatArray, FloatArray]:
        """Next scan in; stamp_ns of the pose, `T_odom_body (4, 4)`, and deskewed points `(N, 3)` within range."""
        if np.isnan(self.voxel_size_m):
            self.voxel_size_m = voxel_size_m(scan.points)
        stamp_ns = self.pose_stamp_ns(scan)
        T_odom_body = self._trajectory.at(np.array([stamp_ns]))[0]
        near = self._near(scan.points)
        self._points = self._deskewed(scan, T_odom_body)[near]
        return stamp_ns, T_odom_body, self._points

    @property
    def thinned(self) -> Float32Array:
        """The last scan's points, one a voxel as fine as KISS-ICP's map."""
        return thinned(self._points, self.voxel_size_m / 2)

    def pose_stamp_ns(self, scan: Scan) -> int:
        """The instant to which the pose of this scan will belong: its last point's."""
        times = self._times(scan)
        return scan.stamp_ns + (round(float(times.max()) * 1e9) if len(times) else 0)

    def in_range(self, scan: Scan) -> int:
        """How many points of the scan lie within the range used."""
        return int(np.count_nonzero(self._near(scan.points)))

    def covers(self, scan: Scan) -> bool:
        """Whether the trajectory reaches from the first to the last point."""
        times = self._times(scan)
        first_ns = scan.stamp_ns + (round(float(times.min()) * 1e9) if len(times) else 0)
        return bool(self._trajectory.covers(np.array([first_ns, self.pose_stamp_ns(scan)])).all())

    def _near(self, points: FloatArray) -> np.ndarray:
        squared = np.einsum("ij,ij->i", points, points)
        return np.asarray((squared > self._settings.min_range_m**2) & (squared < self._settings.max_range_m**2))

    def _times(self, scan: Scan) -> FloatArray:
        if scan.times is None or not self._settings.deskew or len(scan.times) == 0 or np.ptp(scan.times) <= 0:
            return np.zeros(0)
        return scan.times

    def _deskewed(self, scan: Scan, T_odom_body: FloatArray) -> FloatArray:
        """All points where they were seen from at the last point's instant."""
        times = self._times(scan)
        if len(times) == 0:
            return scan.points
        first_s, last_s = times.min(), times.max()

        def T_end_at(share: FloatArray) -> FloatArray:
            stamps_ns = scan.stamp_ns + np.rint((first_s + share * (last_s - first_s)) * 1e9).astype(np.int64)
            return se3.between(T_odom_body, self._trajectory.at(stamps_ns))

        return deskewed(scan.points, times, T_end_at)
