"""Which scans are remembered, and what is kept of them."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import small_gicp
from numpy.typing import NDArray

from wiclosure import se3
from wiclosure.frontends.config import KeyframeSettings
from wiclosure.frontends.reflections import RETURNS, Reflections
from wiclosure.frontends.state import State, packed, part, under, unpacked, unpacked_all
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

    def state(self) -> State:
        """The pose of the last keyframe, if there is one."""
        return {} if self._T_odom_last is None else {"T_odom_last": self._T_odom_last}

    def restore(self, state: State) -> None:
        """Goes on from there."""
        self._T_odom_last = state.get("T_odom_last")

    def _moved(self, T_last_body: FloatArray) -> bool:
        distance_m = float(np.linalg.norm(T_last_body[:3, 3]))
        turn_rad = float(se3.rotation_angle(T_last_body))
        return distance_m >= self._settings.distance_m or turn_rad >= self._settings.rotation_rad


class LocalMap:
    """The last few scans in one frame, for sensors of which one scan shows little."""

    def __init__(self, settings: KeyframeSettings) -> None:
        self._voxel_m = settings.cloud_voxel_size_m
        self._scans: deque[tuple[FloatArray, FloatArray, Reflections | None]] = deque(maxlen=settings.scans)

    def add(self, T_odom_body: FloatArray, points: FloatArray | Float32Array, seen: Reflections | None) -> None:
        """The next scan: its pose `(4, 4)`, and thinned points `(N, 3)` and reflections in its body's axes."""
        self._scans.append((T_odom_body, np.asarray(points, np.float64), seen))

    def seen_from(self, T_odom_body: FloatArray, voxel_m: float) -> Float32Array:
        """All of them in the axes of this pose, `(M, 3)`; thinned to `voxel_m` unless the settings say otherwise."""
        clouds = [se3.transform(se3.between(T_odom_body, pose), points) for pose, points, _ in self._scans]
        return thinned(np.concatenate(clouds), self._voxel_m or voxel_m)

    def state(self) -> State:
        """The scans."""
        seen = [reflections for _, _, reflections in self._scans]
        return {
            "poses": np.array([pose for pose, _, _ in self._scans]).reshape(-1, 4, 4),
            **under("points", packed([points for _, points, _ in self._scans])),
            **under("returns", packed([None if of is None else of.points for of in seen])),
            **under("intensity", packed([None if of is None else of.intensity for of in seen])),
        }

    def restore(self, state: State) -> None:
        """Goes on from there."""
        points, returns, intensity = (part(name, state) for name in ("points", "returns", "intensity"))
        seen = [
            None if of is None or at is None else Reflections(at, of)
            for at, of in zip(unpacked(returns), unpacked(intensity), strict=True)
        ]
        self._scans.extend(zip(state["poses"], unpacked_all(points), seen, strict=True))

    def reflections_from(self, T_odom_body: FloatArray) -> Reflections | None:
        """Those of all of them in the axes of this pose; None if no scan has any."""
        scans = [(se3.between(T_odom_body, pose), seen) for pose, _, seen in self._scans if seen is not None]
        return Reflections.together(scans) if scans else None


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """A scan as odometry returned it.

    Args:
        T_odom_body: `(4, 4)`.
        points: `(N, 3)` deskewed, within range, in the body's axes.
        intensity: `(N,)` of these points, or None.
    """

    T_odom_body: FloatArray
    points: FloatArray
    intensity: Float32Array | None

    def reflections(self, most: int) -> Reflections | None:
        """Some of its returns, at most some `most`; None without intensities."""
        return None if self.intensity is None else Reflections.of(self.points, self.intensity, most)


class KeyframeCollector:
    """Keeps the keyframes of one robot: which scans they are, and their clouds."""

    def __init__(self, settings: KeyframeSettings) -> None:
        self._settings = settings
        self._selector = KeyframeSelector(settings)
        self._last = LocalMap(settings)
        self._indices: list[int] = []
        self._clouds: list[Float32Array] = []
        self._intensities: list[NDArray[np.float16] | None] = []

    def add(self, index: int, registered: Registered, odometry: Odometry) -> bool:
        """The next scan, `index` of the usable ones, as odometry returned it; whether it became a keyframe."""
        T_odom_body, several = registered.T_odom_body, self._settings.scans > 1
        if several:
            self._last.add(T_odom_body, odometry.thinned, registered.reflections(RETURNS // self._settings.scans))
        if not self._selector.select(T_odom_body):
            return False
        self._indices.append(index)
        self._clouds.append(self._cloud(T_odom_body, registered.points, odometry))
        seen = self._last.reflections_from(T_odom_body) if several else registered.reflections(RETURNS)
        self._intensities.append(None if seen is None else seen.at(self._clouds[-1]))
        return True

    def state(self) -> State:
        """All keyframes so far, and what the choice of the next depends on."""
        return {
            "indices": self.indices,
            **under("clouds", packed(self._clouds)),
            **under("intensities", packed(self._intensities)),
            **under("selector", self._selector.state()),
            **under("last", self._last.state()),
        }

    def restore(self, state: State) -> None:
        """Goes on from there."""
        self._indices = state["indices"].tolist()
        self._clouds = unpacked_all(part("clouds", state))
        self._intensities = unpacked(part("intensities", state))
        self._selector.restore(part("selector", state))
        self._last.restore(part("last", state))

    @property
    def indices(self) -> IntArray:
        """`(K,)` which of the usable scans are keyframes."""
        return np.array(self._indices, np.int64)

    @property
    def clouds(self) -> tuple[Float32Array, ...]:
        """K clouds `(N_k, 3)` in the body's axes."""
        return tuple(self._clouds)

    @property
    def intensities(self) -> tuple[NDArray[np.float16], ...] | None:
        """K arrays `(N_k,)`, of the clouds' points; None unless every keyframe's scan has intensities."""
        known = tuple(of for of in self._intensities if of is not None)
        return known if len(known) == len(self._clouds) else None

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
