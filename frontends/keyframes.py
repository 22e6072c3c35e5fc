"""Which scans are remembered, and what is kept of them."""

from __future__ import annotations

from collections import deque

import numpy as np
import small_gicp

from wiclosure import se3
from wiclosure.frontends.config import KeyframeSettings
from wiclosure.interfaces import Odometry
from wiclosure.types import Float32Array, FloatArray, IntArray


class KeyframeSelector:
    """Chooses a scan whenever the robot has moved or turned enough since the last chosen one."""

    def __init__(self, settings: KeyframeSettings | None = None) -> None:
        self._settings = settings or KeyframeSettings()
        self._T_odom_last: FloatArray | None = None

    def select(self, T_odom_body: FloatArray) -> bool:
        """Whether the scan at this pose `(4, 4)` becomes a keyframe; the first always does."""
        if self._T_odom_last is not None and not self._moved(se3.between(self._T_odom_last, T_odom_body)):
            return False
        self._T_odom_last = T_odom_body
        return True

    def _moved(self, T_last_body: FloatArray) -> bool:
        distance_m = float(np.linalg.norm(T_last_body[:3, 3]))
        turn_rad = float(se3.rotation_angle(T_last_body))
        return distance_m >= self._settings.distance_m or turn_rad >= self._settings.rotation_rad


class LocalMap:
    """The last few scans in one frame, for sensors of which one scan shows little."""

    def __init__(self, settings: KeyframeSettings) -> None:
        self._voxel_m = settings.cloud_voxel_size_m
        self._scans: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=settings.scans)

    def add(self, T_odom_body: FloatArray, points: FloatArray | Float32Array) -> None:
        """The next scan: its pose `(4, 4)`, and thinned points `(N, 3)` in its body's axes."""
        self._scans.append((T_odom_body, np.asarray(points, np.float64)))

    def seen_from(self, T_odom_body: FloatArray, voxel_m: float) -> Float32Array:
        """All of them in the axes of this pose, `(M, 3)`; thinned to `voxel_m` unless the settings say otherwise."""
        clouds = [se3.transform(se3.between(T_odom_body, pose), points) for pose, points in self._scans]
        return thinned(np.concatenate(clouds), self._voxel_m or voxel_m)


class KeyframeCollector:
    """Keeps the keyframes of one robot: which scans they are, and their clouds."""

    def __init__(self, settings: KeyframeSettings) -> None:
        self._settings = settings
        self._selector = KeyframeSelector(settings)
        self._last = LocalMap(settings)
        self._indices: list[int] = []
        self._clouds: list[Float32Array] = []

    def add(self, index: int, T_odom_body: FloatArray, points: FloatArray, odometry: Odometry) -> bool:
        """The next scan, `index` of the usable ones, its pose and deskewed points; whether it became a keyframe."""
        if self._settings.scans > 1:
            self._last.add(T_odom_body, odometry.thinned)
        if not self._selector.select(T_odom_body):
            return False
        self._indices.append(index)
        self._clouds.append(self._cloud(T_odom_body, points, odometry))
        return True

    @property
    def indices(self) -> IntArray:
        """`(K,)` which of the usable scans are keyframes."""
        return np.array(self._indices, np.int64)

    @property
    def clouds(self) -> tuple[Float32Array, ...]:
        """K clouds `(N_k, 3)` in the body's axes."""
        return tuple(self._clouds)

    def _cloud(self, T_odom_body: FloatArray, points: FloatArray, odometry: Odometry) -> Float32Array:
        if self._settings.scans > 1:
            return self._last.seen_from(T_odom_body, odometry.voxel_size_m / 2)
        if self._settings.cloud_voxel_size_m is None:
            return odometry.thinned.astype(np.float32)
        return thinned(points, self._settings.cloud_voxel_size_m)


def thinned(points: FloatArray, voxel_size_m: float) -> Float32Array:
    """One point per voxel, the mean of those in it: `(N, 3)` to `(M, 3)` float32."""
    if len(points) == 0:
        return np.zeros((0, 3), np.float32)
    # One thread: with more, the result differs from run to run.
    means = small_gicp.voxelgrid_sampling(points, voxel_size_m, num_threads=1).points()
    return np.asarray(means[:, :3], np.float32, order="C")
