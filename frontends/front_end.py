"""One robot's way through its scans: odometry, keyframes and their descriptors."""

from __future__ import annotations

import logging
import time

import numpy as np

from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.frontends.config import FrontEndSettings
from wiclosure.frontends.front_end_result import FrontEndCounts, FrontEndResult
from wiclosure.frontends.keyframes import KeyframeSelector, thinned
from wiclosure.frontends.odometry import KissOdometry
from wiclosure.frontends.scan_context import describe
from wiclosure.types import FloatArray, Keyframe, KeyframeId, Scan, Trajectory

__all__ = ["FrontEnd", "FrontEndResult"]

logger = logging.getLogger(__name__)

# Six unknowns need a few points; what a scan with fewer than these says of the pose is chance.
_FEWEST_POINTS = 100


class FrontEnd:
    """Takes one robot's scans one by one; what it keeps grows with the keyframes only (and one pose a scan).

    Args:
        settings: of odometry, keyframes and descriptors.
        robot: name of the robot.
        drift: how fast its odometry goes wrong; goes into the trajectories.
    """

    def __init__(self, settings: FrontEndSettings, robot: str, drift: DriftModel | None = None) -> None:
        self._settings = settings
        self._robot = robot
        self._drift = drift or DriftModel()
        self._odometry = KissOdometry(settings.odometry)
        self._selector = KeyframeSelector(settings.keyframes)
        self._stamps_ns: list[int] = []
        self._poses: list[FloatArray] = []
        self._keyframes: list[Keyframe] = []
        self._keyframe_indices: list[int] = []
        self._scans = self._sparse = self._late = 0
        self._seconds_odometry = self._seconds_descriptors = 0.0

    def process(self, scan: Scan) -> Keyframe | None:
        """Next scan in; the keyframe made of it, if it became one.

        Scans with too few points and scans that do not follow the last in time are left out and counted.
        """
        self._scans += 1
        if not self._usable(scan):
            return None
        started = time.perf_counter()
        stamp_ns, T_odom_body, points = self._odometry.register(scan)
        self._stamps_ns.append(stamp_ns)
        self._poses.append(T_odom_body)
        finished = time.perf_counter()
        self._seconds_odometry += finished - started
        if not self._selector.select(T_odom_body):
            return None
        keyframe = self._remember(stamp_ns, T_odom_body, points)
        self._seconds_descriptors += time.perf_counter() - finished
        return keyframe

    def result(self) -> FrontEndResult:
        """All that was found so far.

        Raises:
            InputError: no scan was usable.
        """
        if not self._poses:
            raise InputError(
                f"robot {self._robot}: none of {self._scans} scans has {_FEWEST_POINTS} points between"
                f" {self._settings.odometry.min_range_m:g} and {self._settings.odometry.max_range_m:g} m;"
                " check the topic and odometry.min_range_m and max_range_m"
            )
        odometry = Trajectory(self._robot, np.array(self._stamps_ns, np.int64), np.array(self._poses), self._drift)
        indices = np.array(self._keyframe_indices, np.int64)
        return FrontEndResult(
            robot=self._robot,
            odometry=odometry,
            keyframe_indices=indices,
            keyframes=odometry.keyframes(indices),
            clouds=tuple(k.cloud for k in self._keyframes),
            descriptors=np.stack([k.descriptor for k in self._keyframes]),
            counts=FrontEndCounts(self._scans, self._sparse, self._late),
            seconds_odometry=self._seconds_odometry,
            seconds_descriptors=self._seconds_descriptors,
        )

    def _usable(self, scan: Scan) -> bool:
        if self._odometry.in_range(scan) < _FEWEST_POINTS:
            self._sparse += 1
            logger.debug("%s: scan at %d ns has too few points, left out", self._robot, scan.stamp_ns)
            return False
        if self._stamps_ns and self._odometry.pose_stamp_ns(scan) <= self._stamps_ns[-1]:
            self._late += 1
            logger.debug("%s: scan at %d ns does not follow the last, left out", self._robot, scan.stamp_ns)
            return False
        return True

    def _remember(self, stamp_ns: int, T_odom_body: FloatArray, points: FloatArray) -> Keyframe:
        voxel_m = self._settings.keyframes.cloud_voxel_size_m
        keyframe = Keyframe(
            key=KeyframeId(self._robot, len(self._keyframes)),
            stamp_ns=stamp_ns,
            T_odom_body=T_odom_body,
            cloud=self._odometry.thinned.astype(np.float32) if voxel_m is None else thinned(points, voxel_m),
            descriptor=describe(points, self._settings.scan_context),
        )
        self._keyframes.append(keyframe)
        self._keyframe_indices.append(len(self._poses) - 1)
        return keyframe
