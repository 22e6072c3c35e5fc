"""Odometry that the robot brings along (wheels, LIO-SAM, FAST-LIO ...) in the place of KISS-ICP's."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.keyframes import thinned
from wiclosure.frontends.odometry.deskewing import deskewed
from wiclosure.frontends.odometry.sweep import sweep_stamps_ns, sweep_times, within_range
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.frontends.state import State
from wiclosure.interfaces import Hold
from wiclosure.types import BoolArray, Float32Array, FloatArray, Scan, Trajectory

_LONGEST_STEP_NS = 10**9  # between sparser poses, more than interpolation would be guessed


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
        steps_ns = np.diff(trajectory.stamps_ns)
        self._step_ns = min(int(np.median(steps_ns)), _LONGEST_STEP_NS) if len(steps_ns) else 0
        self._points: FloatArray | None = None
        self.kept: BoolArray = np.zeros(0, bool)

    def register(self, scan: Scan) -> tuple[int, FloatArray, FloatArray]:
        """Next scan in; stamp_ns of the pose, `T_odom_body (4, 4)`, and deskewed points `(N, 3)` within range."""
        if np.isnan(self.voxel_size_m):
            self.voxel_size_m = voxel_size_m(scan.points)
        stamp_ns = int(sweep_stamps_ns(scan, self._settings)[1])
        T_odom_body = self._trajectory.at_or_beyond(np.array([stamp_ns]))[0]
        self.kept = within_range(scan.points, self._settings)
        self._points = points = self._deskewed(scan, T_odom_body)[self.kept]
        return stamp_ns, T_odom_body, points

    @property
    def hold(self) -> Hold:
        """Whether it holds, scans do not tell here: the poses stand."""
        return Hold.HELD

    @property
    def thinned(self) -> Float32Array:
        """The last scan's points, one per voxel as fine as KISS-ICP's map.

        Raises:
            ValueError: no scan was registered yet.
        """
        if self._points is None:
            raise ValueError("no scan was registered yet")
        return thinned(self._points, self.voxel_size_m / 2)

    def state(self) -> State:
        """What the next scans depend on, and the last one; the trajectory stands."""
        last = {} if self._points is None else {"points": self._points, "kept": self.kept}
        return {"voxel_size_m": np.array(self.voxel_size_m), **last}

    def restore(self, state: State) -> None:
        """Goes on from there."""
        self.voxel_size_m = float(state["voxel_size_m"])
        self._points, self.kept = state.get("points"), state.get("kept", self.kept)

    def covers(self, scan: Scan) -> bool:
        """Whether the trajectory has the scan's stamp, to half a sweep or half of its own steps, and nearly all points.

        Stamps are rounded, and where odometry has a pose for each scan, the last sweep ends after the last of them: the
        motion then goes on evenly.
        """
        ends_ns = sweep_stamps_ns(scan, self._settings)
        sweep_ns = int(ends_ns[1] - ends_ns[0])
        tolerance_ns = max(sweep_ns, self._step_ns) // 2
        has_stamp = self._trajectory.covers(np.array([scan.stamp_ns]), tolerance_ns)
        return bool(has_stamp.all() and self._trajectory.covers(ends_ns, tolerance_ns + sweep_ns).all())

    def _deskewed(self, scan: Scan, T_odom_body: FloatArray) -> FloatArray:
        """All points where they were seen from at the last point's instant."""
        times = sweep_times(scan, self._settings)
        if len(times) == 0:
            return scan.points
        first_s, last_s = times.min(), times.max()

        def T_end_at(share: FloatArray) -> FloatArray:
            stamps_ns = scan.stamp_ns + np.rint((first_s + share * (last_s - first_s)) * 1e9).astype(np.int64)
            return se3.between(T_odom_body, self._trajectory.at_or_beyond(stamps_ns))

        return deskewed(scan.points, times, T_end_at)
