"""Odometry by KISS-ICP, with the pose's time stated right."""

from __future__ import annotations

import logging

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
from kiss_icp.kiss_icp import KissICP

from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.types import FloatArray, Scan

logger = logging.getLogger(__name__)

_NO_TIMES = np.zeros(0)


class KissOdometry:
    """Follows one sensor with KISS-ICP (Vizzo et al., RA-L 2023).

    KISS-ICP maps the times of a scan's points linearly from [first, last] to [0, 1] and deskews to 1: a deskewed cloud,
    and its pose, belong to the instant of the *last* point.  Without times they belong to the scan's own stamp.
    """

    def __init__(self, settings: OdometrySettings | None = None) -> None:
        self._settings = settings or OdometrySettings()
        self._kiss: KissICP | None = None
        self.voxel_size_m = self._settings.voxel_size_m or float("nan")

    def register(self, scan: Scan) -> tuple[int, FloatArray, FloatArray]:
        """Next scan in; pose and deskewed points out.

        Returns:
            stamp_ns of the pose, `T_odom_body (4, 4)`, and the points `(N, 3)` within range in the body's axes at that
            instant.
        """
        if self._kiss is None:
            self._kiss = self._start(scan)
        times = self._sweep_times(scan)
        points, _ = self._kiss.register_frame(scan.points, times)
        return self.pose_stamp_ns(scan), np.array(self._kiss.last_pose), points

    def pose_stamp_ns(self, scan: Scan) -> int:
        """The instant to which the pose of this scan will belong."""
        times = self._sweep_times(scan)
        return scan.stamp_ns + (round(float(times.max()) * 1e9) if len(times) else 0)

    def in_range(self, scan: Scan) -> int:
        """How many points of the scan lie within the range used."""
        squared = np.einsum("ij,ij->i", scan.points, scan.points)
        low, high = self._settings.min_range_m**2, self._settings.max_range_m**2
        return int(np.count_nonzero((squared > low) & (squared < high)))

    def _sweep_times(self, scan: Scan) -> FloatArray:
        """Times to deskew by; none where they are absent, all alike (KISS-ICP would divide by zero), or not wanted."""
        if scan.times is None or not self._settings.deskew or len(scan.times) == 0 or np.ptp(scan.times) <= 0:
            return _NO_TIMES
        return scan.times

    def _start(self, first: Scan) -> KissICP:
        settings = self._settings
        if settings.voxel_size_m is None:
            self.voxel_size_m = voxel_size_m(first.points)
        logger.debug("odometry: voxels of %.3f m", self.voxel_size_m)
        return KissICP(
            KISSConfig(
                data=DataConfig(max_range=settings.max_range_m, min_range=settings.min_range_m, deskew=settings.deskew),
                mapping=MappingConfig(voxel_size=self.voxel_size_m),
                registration=RegistrationConfig(max_num_threads=settings.num_threads),
            )
        )
