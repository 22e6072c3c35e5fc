"""One robot follows its scans: odometry, keyframes and their descriptors."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure.errors import InputError
from wiclosure.frontends.config import KeyframeSettings, OdometrySettings, ScanContextSettings
from wiclosure.frontends.elevation import elevation_corrected
from wiclosure.frontends.front_end_result import Descriptors, FrontEndCounts, FrontEndResult, OdometryResult
from wiclosure.frontends.keyframes import KeyframeCollector, Registered
from wiclosure.frontends.odometry.registry import make_odometry
from wiclosure.frontends.odometry.sweep import sweep_stamps_ns, within_range
from wiclosure.frontends.place_recognition.scan_context import describe
from wiclosure.frontends.state import Resumable, State, part, under
from wiclosure.interfaces import Hold
from wiclosure.types import Float32Array, FloatArray, Scan, Trajectory

__all__ = ["Followed", "FrontEndResult", "OdometryRun", "describe_all", "describe_shifted"]

logger = logging.getLogger(__name__)

# Six unknowns need a few points; what a scan with fewer than these says of the pose is chance.
_FEWEST_POINTS = 100


@dataclass(frozen=True, slots=True, eq=False)
class Followed:
    """A scan as odometry followed it, to be looked at.

    Args:
        stamp_ns: of the pose.
        T_odom_body: `(4, 4)`.
        points: `(M, 3)` m, thinned, in the body's axes.
    """

    stamp_ns: int
    T_odom_body: FloatArray
    points: Float32Array


class OdometryRun:
    """Takes one robot's scans one by one; what it keeps grows with the keyframes only (and one pose per scan).

    Another one goes on from its `state` between two scans to the same result, bit by bit.

    Args:
        settings: of odometry.
        keyframes: which scans are kept, and how finely; each of several settings has a result of its own.
        robot: name of the robot, for messages.
        recorded: the odometry that the robot brings along, `T_odom_lidar`; whether it is used is `settings.source`'s.
    """

    def __init__(
        self,
        settings: OdometrySettings,
        keyframes: Sequence[KeyframeSettings],
        robot: str,
        recorded: Trajectory | None = None,
    ) -> None:
        self._settings, self._robot = settings, robot
        self._odometry = make_odometry(settings, recorded)
        self._keyframes = [KeyframeCollector(of) for of in keyframes]
        self._stamps_ns: list[int] = []
        self._scan_stamps_ns: list[int] = []
        self._poses: list[FloatArray] = []
        self._holds: list[Hold] = []
        self._scans = self._sparse = self._late = self._outside = 0
        self._seconds = self._seconds_reading = 0.0

    def process_all(self, scans: Iterable[Scan]) -> None:
        """All scans in, one after the other; what waiting for them takes is added up apart."""
        began = time.perf_counter()
        for scan in scans:
            self._seconds_reading += time.perf_counter() - began
            self.process(scan)
            began = time.perf_counter()
        self._seconds_reading += time.perf_counter() - began

    def process(self, scan: Scan) -> bool:
        """Next scan in; whether it became a keyframe by the first settings.

        Scans with too few points and scans that do not follow the last in time are left out and counted.
        """
        self._scans += 1
        started = time.perf_counter()
        if self._settings.elevation_correction_deg:
            scan = replace(scan, points=elevation_corrected(scan.points, self._settings.elevation_correction_deg))
        chosen = self._usable(scan) and self._follow(scan)
        self._seconds += time.perf_counter() - started
        return chosen

    @property
    def scans(self) -> int:
        """How many scans went in so far."""
        return self._scans

    @property
    def last(self) -> Followed | None:
        """The last scan that was followed, or None before the first."""
        if not self._poses:
            return None
        return Followed(self._stamps_ns[-1], self._poses[-1], np.asarray(self._odometry.thinned, np.float32))

    def results(self) -> tuple[OdometryResult, ...]:
        """All that was found so far, one for each settings of keyframes.

        Raises:
            InputError: no scan was usable.
        """
        if not self._poses:
            raise InputError(
                f"robot {self._robot}: none of {self._scans} scans has {_FEWEST_POINTS} points between"
                f" {self._settings.min_range_m:g} and {self._settings.max_range_m:g} m"
                + (" and lies within the time of the odometry" if self._outside else "")
                + "; check the topic and odometry.min_range_m and max_range_m"
            )
        stamps_ns, poses = np.array(self._stamps_ns, np.int64), np.array(self._poses)
        found_again, lost = (
            np.array([n for n, hold in enumerate(self._holds) if hold is one], np.int64)
            for one in (Hold.FOUND_AGAIN, Hold.LOST)
        )
        counts = FrontEndCounts(self._scans, self._sparse, self._late, self._outside)
        return tuple(
            OdometryResult(
                stamps_ns=stamps_ns,
                scan_stamps_ns=np.array(self._scan_stamps_ns, np.int64),
                poses=poses,
                keyframe_indices=kept.indices,
                clouds=kept.clouds,
                intensities=kept.intensities,
                counts=counts,
                seconds=self._seconds,
                seconds_reading=self._seconds_reading,
                found_again=found_again,
                lost=lost,
            )
            for kept in self._keyframes
        )

    @property
    def resumable(self) -> bool:
        """Whether its odometry tells its state; one that others plug in need not."""
        return isinstance(self._odometry, Resumable)

    def state(self) -> State:
        """All that was found so far, and what the next scans depend on.

        Raises:
            TypeError: the odometry does not tell its own.
        """
        if not isinstance(self._odometry, Resumable):
            raise TypeError(f"{type(self._odometry).__name__} tells no state")
        state = {
            "stamps_ns": np.array(self._stamps_ns, np.int64),
            "scan_stamps_ns": np.array(self._scan_stamps_ns, np.int64),
            "poses": np.array(self._poses).reshape(-1, 4, 4),
            "holds": np.array([hold.value for hold in self._holds], np.str_),
            "counts": np.array([self._scans, self._sparse, self._late, self._outside], np.int64),
            "seconds": np.array([self._seconds, self._seconds_reading]),
            **under("odometry", self._odometry.state()),
        }
        for number, kept in enumerate(self._keyframes):
            state |= under(f"keyframes{number}", kept.state())
        return state

    def restore(self, state: State) -> None:
        """Goes on from there.

        Raises:
            TypeError: the odometry cannot.
            KeyError, ValueError, IndexError: it is not the state of a run with these settings.
        """
        if not isinstance(self._odometry, Resumable):
            raise TypeError(f"{type(self._odometry).__name__} takes no state")
        self._stamps_ns, self._scan_stamps_ns = state["stamps_ns"].tolist(), state["scan_stamps_ns"].tolist()
        self._poses, self._holds = list(state["poses"]), [Hold(value) for value in state["holds"].tolist()]
        self._scans, self._sparse, self._late, self._outside = state["counts"].tolist()
        self._seconds, self._seconds_reading = state["seconds"].tolist()
        self._odometry.restore(part("odometry", state))
        for number, kept in enumerate(self._keyframes):
            kept.restore(part(f"keyframes{number}", state))

    def _usable(self, scan: Scan) -> bool:
        if np.count_nonzero(within_range(scan.points, self._settings)) < _FEWEST_POINTS:
            self._sparse += 1
            logger.debug("%s: scan at %d ns has too few points, left out", self._robot, scan.stamp_ns)
            return False
        if self._stamps_ns and (
            sweep_stamps_ns(scan, self._settings)[1] <= self._stamps_ns[-1] or scan.stamp_ns <= self._scan_stamps_ns[-1]
        ):
            self._late += 1
            logger.debug("%s: scan at %d ns does not follow the last, left out", self._robot, scan.stamp_ns)
            return False
        if not self._odometry.covers(scan):
            self._outside += 1
            logger.debug("%s: scan at %d ns is outside the odometry, left out", self._robot, scan.stamp_ns)
            return False
        return True

    def _follow(self, scan: Scan) -> bool:
        stamp_ns, T_odom_body, points = self._odometry.register(scan)
        self._stamps_ns.append(stamp_ns)
        self._scan_stamps_ns.append(scan.stamp_ns)
        self._poses.append(T_odom_body)
        self._holds.append(self._odometry.hold)
        index = len(self._poses) - 1
        intensity = None if scan.intensity is None else scan.intensity[self._odometry.kept]
        registered = Registered(T_odom_body, points, intensity)
        chosen = [kept.add(index, registered, self._odometry) for kept in self._keyframes]
        return chosen[0]


def describe_all(clouds: Sequence[Float32Array], settings: ScanContextSettings) -> Descriptors:
    """Scan contexts of keyframe clouds."""
    started = time.perf_counter()
    images = np.stack([describe(cloud, settings) for cloud in clouds])
    return Descriptors(images, time.perf_counter() - started)


def describe_shifted(
    clouds: Sequence[Float32Array], settings: ScanContextSettings, lateral_shift_m: float | None
) -> tuple[Float32Array, ...]:
    """Descriptors `(K, rings, sectors)` as if the sensor had stood so far to the left, and to the right; or none."""
    if lateral_shift_m is None:
        return ()
    sides = (np.array([0.0, side * lateral_shift_m, 0.0], np.float32) for side in (-1, 1))
    return tuple(describe_all([cloud + side for cloud in clouds], settings).images for side in sides)
