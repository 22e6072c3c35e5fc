"""Odometry by KISS-ICP, with the pose's time stated right."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
from kiss_icp.kiss_icp import KissICP

from wiclosure import se3
from wiclosure.frontends.config import OdometrySettings
from wiclosure.frontends.odometry.deskewing import deskewed
from wiclosure.frontends.odometry.hold import HoldingRegistration
from wiclosure.frontends.odometry.sweep import sweep_stamps_ns, sweep_times, within_range
from wiclosure.frontends.scale import voxel_size_m
from wiclosure.frontends.state import State, part, under
from wiclosure.interfaces import Hold
from wiclosure.types import BoolArray, FloatArray, Scan

logger = logging.getLogger(__name__)

# Stamps jitter: a sweep within this share of the time between scans is taken to fill it, as KISS-ICP assumes.
_JITTER = 0.25

_SEARCHED_VOXELS = 2.0  # how far the neighbours of a voxel reach


class KissOdometry:
    """Follows one sensor with KISS-ICP (Vizzo et al., RA-L 2023).

    Points are deskewed to the instant of the *last* one, as KISS-ICP does it: a deskewed cloud, and its pose, belong to
    that.  Without times they belong to the scan's own stamp.

    KISS-ICP takes the sweep to last from one scan to the next.  In a recording that was thinned or that lost scans it
    does not, and the deskewing would overshoot: here the motion is scaled to the true duration of the sweep.
    """

    def __init__(self, settings: OdometrySettings | None = None) -> None:
        self._settings = settings or OdometrySettings()
        self._kiss: _KissICP | None = None
        self._last_stamps_ns: tuple[int, ...] = ()
        self.voxel_size_m = self._settings.voxel_size_m or float("nan")

    def register(self, scan: Scan) -> tuple[int, FloatArray, FloatArray]:
        """Next scan in; pose and deskewed points out.

        Returns:
            stamp_ns of the pose, `T_odom_body (4, 4)`, and the points `(N, 3)` within range in the body's axes at that
            instant.
        """
        if self._kiss is None:
            self._kiss = self._start(scan)
        times, stamp_ns = sweep_times(scan, self._settings), int(sweep_stamps_ns(scan, self._settings)[1])
        self._kiss.preprocessor.motion_share = self._motion_share(times)
        if self._last_stamps_ns:
            self._kiss.registration.step_s = (stamp_ns - self._last_stamps_ns[-1]) * 1e-9
        points, _ = self._kiss.register_frame(scan.points, times)
        self._last_stamps_ns = (*self._last_stamps_ns[-1:], stamp_ns)
        return stamp_ns, np.array(self._kiss.last_pose), points

    @property
    def kept(self) -> BoolArray:
        """`(M,)` which of the last scan's points were returned.

        Raises:
            ValueError: no scan was registered yet.
        """
        if self._kiss is None:
            raise ValueError("no scan was registered yet")
        return self._kiss.preprocessor.kept

    @property
    def hold(self) -> Hold:
        """Whether the last scan fits the one before, where it was put."""
        return Hold.HELD if self._kiss is None else self._kiss.registration.hold

    @property
    def thinned(self) -> FloatArray:
        """The last scan's points as they went into the map: `(M, 3)`, one per voxel of half `voxel_size_m`.

        Raises:
            ValueError: no scan was registered yet.
        """
        if self._kiss is None:
            raise ValueError("no scan was registered yet")
        return self._kiss.frame_downsample

    def covers(self, scan: Scan) -> bool:
        """Whether the scan can be followed: KISS-ICP follows all."""
        return True

    def state(self) -> State:
        """All that the next scans depend on; empty before the first.

        `map_points (M, 3)` are voxel by voxel, in each in the order in which they came: added anew they make the same
        map.  `deviations (S, 4, 4)` are by how much predictions were off: KISS-ICP does not tell the sum that it keeps.
        """
        kiss = self._kiss
        if kiss is None:
            return {}
        return {
            "voxel_size_m": np.array(self.voxel_size_m),
            "last_stamps_ns": np.array(self._last_stamps_ns, np.int64),
            "last_pose": kiss.last_pose,
            "last_delta": kiss.last_delta,
            "map_points": kiss.local_map.point_cloud(),
            "deviations": np.array(kiss.adaptive_threshold.deviations).reshape(-1, 4, 4),
            "thinned": kiss.frame_downsample,
            "kept": kiss.preprocessor.kept,
            **under("registration", kiss.registration.state()),
        }

    def restore(self, state: State) -> None:
        """Goes on from there."""
        if not state:
            return
        self.voxel_size_m = float(state["voxel_size_m"])
        self._last_stamps_ns = tuple(state["last_stamps_ns"].tolist())
        kiss = self._kiss = self._made()
        kiss.last_pose, kiss.last_delta = state["last_pose"], state["last_delta"]
        kiss.local_map.add_points(state["map_points"])
        for deviation in state["deviations"]:
            kiss.adaptive_threshold.update_model_deviation(deviation)
        kiss.frame_downsample, kiss.preprocessor.kept = state["thinned"], state["kept"]
        kiss.registration.restore(part("registration", state))

    def _motion_share(self, times: FloatArray) -> float:
        """What share of the last motion between two scans happens during a sweep of these times."""
        if len(times) == 0 or len(self._last_stamps_ns) < 2:
            return 1.0
        interval_s = (self._last_stamps_ns[1] - self._last_stamps_ns[0]) * 1e-9
        share = float(np.ptp(times)) / max(interval_s, 1e-6)
        return 1.0 if abs(share - 1.0) < _JITTER else min(share, 1.0)

    def _start(self, first: Scan) -> _KissICP:
        if self._settings.voxel_size_m is None:
            self.voxel_size_m = voxel_size_m(first.points)
        logger.debug("odometry: voxels of %.3f m", self.voxel_size_m)
        return self._made()

    def _made(self) -> _KissICP:
        settings = self._settings
        kiss = _KissICP(
            KISSConfig(
                data=DataConfig(max_range=settings.max_range_m, min_range=settings.min_range_m, deskew=settings.deskew),
                mapping=MappingConfig(voxel_size=self.voxel_size_m, max_points_per_voxel=settings.points_per_voxel),
                registration=RegistrationConfig(
                    max_num_threads=settings.num_threads, convergence_criterion=settings.convergence
                ),
            )
        )
        kiss.preprocessor = _SweepPreprocessor(settings)
        kiss.registration = HoldingRegistration(kiss.registration, lambda: kiss.frame_downsample, self.voxel_size_m)
        kiss.adaptive_threshold = _BoundedThreshold(kiss.adaptive_threshold, _SEARCHED_VOXELS * self.voxel_size_m)
        return kiss


class _BoundedThreshold:
    """KISS-ICP's adaptive threshold, no wider than its map is searched.

    It widens to what an unforeseen turn moves a point at the sensor's range: 75 m in rooms.  But matches are looked for
    in the neighbouring voxels only, and a kernel far wider than these weighs wrong ones as much as true ones.
    """

    def __init__(self, threshold: Any, most_m: float) -> None:
        self._threshold, self._most_m = threshold, most_m
        self.deviations: list[FloatArray] = []

    def get_threshold(self) -> float:
        """The standard deviation that is expected of the prediction, m."""
        return min(float(self._threshold.get_threshold()), self._most_m)

    def update_model_deviation(self, model_deviation: FloatArray) -> None:
        """By how much the last prediction was off, `(4, 4)`."""
        self.deviations.append(model_deviation)
        self._threshold.update_model_deviation(model_deviation)


class _KissICP(KissICP):  # type: ignore[misc]  # kiss-icp publishes no types
    """KISS-ICP that keeps the thinned scan: thinning it again for keyframes would take as long as describing it."""

    frame_downsample: FloatArray
    adaptive_threshold: _BoundedThreshold
    registration: HoldingRegistration
    preprocessor: _SweepPreprocessor

    def voxelize(self, iframe: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The points to register, and those for the map."""
        source, self.frame_downsample = super().voxelize(iframe)
        return source, self.frame_downsample


class _SweepPreprocessor:
    """In the place of KISS-ICP's own: deskewing by the motion that happens during the sweep, then its range limits."""

    def __init__(self, settings: OdometrySettings) -> None:
        self._settings = settings
        self.motion_share = 1.0
        self.kept: BoolArray = np.zeros(0, bool)

    def preprocess(self, points: FloatArray, times: FloatArray, T_last_now: FloatArray) -> FloatArray:
        """Points `(N, 3)` in, those within range at the instant of the last point out; the motion goes on evenly."""
        if len(times):
            motion = self.motion_share * se3.log(T_last_now)
            points = deskewed(points, times, lambda share: se3.exp((share - 1.0)[:, None] * motion))
        self.kept = within_range(points, self._settings)
        return np.asarray(points.take(np.flatnonzero(self.kept), axis=0))
