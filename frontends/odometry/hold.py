"""Whether an odometry holds: does a scan show what the last ones showed, where it was put?  If not, it is found again.

Registration settles near its start.  After a turn that nothing foretold, the right pose lies beyond its reach, and it
settles elsewhere without a word.  But then few points fall where the last scans had some: three of four where it
holds, half or fewer from 5 degrees off.  Such a scan is registered to the last ones anew, from all around.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from wiclosure import se3
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.registration.initial_guesses import around_scan_context
from wiclosure.frontends.registration.methods import CoarseToFineGicp
from wiclosure.frontends.registration.prepared_cloud import PreparedCloud
from wiclosure.frontends.state import State, packed, part, under, unpacked_all
from wiclosure.interfaces import Hold
from wiclosure.types import BoolArray, FloatArray, IntArray

_DOUBTFUL = 0.8  # of the usual share: it costs a search, no more
_LOST = 2 / 3  # of the usual share, after the search: nothing holds the step
_BETTER = 0.05  # of the points, by which another pose must fit better to be taken: chance moves some hundredths
_RECENT = 20  # scans that tell what is usual
_POINTS = 1000  # that are looked at
_TOGETHER = 5  # last scans that a scan must fit: one alone may look elsewhere
_TURNS = 8  # around the circle that a search starts from: GICP's coarse level reaches from each to the next
_FASTEST_RPS = np.pi  # rad/s, that robots turn
_KERNEL_VOXELS = 1 / 3  # of KISS-ICP where the start is good: correspondences within a voxel
_BITS = 21  # of each axis of a voxel's number


@dataclass(frozen=True, eq=False)
class Occupied:
    """Which voxels of an edge `voxel_m` a scan has points in.

    Args:
        numbers: `(M,)` sorted numbers of voxels, some more than once.
        voxel_m: their edge.
    """

    numbers: IntArray
    voxel_m: float

    @classmethod
    def by(cls, points: FloatArray, voxel_m: float) -> Self:
        """Those of the points `(N, 3)`."""
        return cls(np.sort(_numbers(points, voxel_m)), voxel_m)

    def holds(self, points: FloatArray) -> BoolArray:
        """Which of the points `(N, 3)` lie in occupied voxels."""
        if not len(self.numbers):
            return np.zeros(len(points), bool)
        numbers = _numbers(points, self.voxel_m)
        place = np.minimum(np.searchsorted(self.numbers, numbers), len(self.numbers) - 1)
        return np.asarray(self.numbers[place] == numbers)


def _numbers(points: FloatArray, voxel_m: float) -> IntArray:
    cell = np.floor(points / voxel_m).astype(np.int64) & ((1 << _BITS) - 1)
    return np.asarray((cell[:, 0] << 2 * _BITS) | (cell[:, 1] << _BITS) | cell[:, 2])


@dataclass(frozen=True, eq=False)
class _Followed:
    """A scan that was followed: its pose `(4, 4)`, points `(N, 3)` in its own axes, and what they occupy in the map."""

    pose: FloatArray
    points: FloatArray
    occupied: Occupied

    @classmethod
    def of(cls, pose: FloatArray, points: FloatArray, voxel_m: float) -> Self:
        """The scan that was found there."""
        return cls(pose, points, Occupied.by(se3.transform(pose, points), voxel_m))


class HoldingRegistration:
    """KISS-ICP's registration, which looks at what it found and searches anew where that does not fit.

    Args:
        registration: KISS-ICP's.
        thinned: the present scan's points `(N, 3)` as they go into the map.
        voxel_m: of the map.
    """

    def __init__(self, registration: Any, thinned: Callable[[], FloatArray], voxel_m: float) -> None:
        self._registration, self._thinned, self._voxel_m = registration, thinned, voxel_m
        self._last: deque[_Followed] = deque(maxlen=_TOGETHER)
        self._shares: deque[float] = deque(maxlen=_RECENT)
        self.hold = Hold.HELD
        self.step_s = np.inf  # since the scan before, where known

    def state(self) -> State:
        """The last scans, which shares of points fell where they had some, and how it stands with the last of them."""
        return {
            "poses": np.array([scan.pose for scan in self._last]).reshape(-1, 4, 4),
            "shares": np.array(self._shares),
            "hold": np.array(self.hold.value),
            **under("points", packed([scan.points for scan in self._last])),
        }

    def restore(self, state: State) -> None:
        """Goes on from there."""
        scans = zip(state["poses"], unpacked_all(part("points", state)), strict=True)
        self._last.extend(_Followed.of(pose, points, self._voxel_m) for pose, points in scans)
        self._shares.extend(state["shares"].tolist())
        self.hold = Hold(str(state["hold"]))

    def align_points_to_map(
        self,
        points: FloatArray,
        voxel_map: Any,
        initial_guess: FloatArray,
        max_correspondance_distance: float,
        kernel: float,
    ) -> FloatArray:
        """The pose `(4, 4)` of the next scan in the map; the names are KISS-ICP's.

        `hold` tells whether the scan fits there.
        """

        def aligned(start: FloatArray, sigma_m: float, reach_m: float) -> FloatArray:
            found = self._registration.align_points_to_map(points, voxel_map, start, reach_m, sigma_m)
            return np.asarray(found, np.float64)

        pose = aligned(initial_guess, kernel, max_correspondance_distance)
        self.hold = Hold.HELD
        if self._last:
            share = self._share(points, pose)
            # At the first step nothing tells what is usual: it is doubted where a robot may have turned beyond reach.
            beyond_reach = _FASTEST_RPS * self.step_s > np.pi / _TURNS
            if share < _DOUBTFUL * float(np.median(self._shares)) if self._shares else beyond_reach:
                sigma_m = _KERNEL_VOXELS * self._voxel_m
                found = self._searched(initial_guess)
                starts = [initial_guess, pose, *found]
                poses = [*found, *(aligned(start, sigma_m, 3.0 * sigma_m) for start in starts)]
                shares = [self._share(points, other) for other in poses]
                if max(shares) >= share + _BETTER:
                    before, pose, share = pose, poses[int(np.argmax(shares))], max(shares)
                    lost = self._shares and self._apart_m(points, before, pose) > self._voxel_m
                    self.hold = Hold.FOUND_AGAIN if lost else Hold.HELD
                if self._shares and share < _LOST * float(np.median(self._shares)):
                    self.hold = Hold.LOST
            self._shares.append(share)
        self._last.append(_Followed.of(pose, self._thinned(), self._voxel_m))
        return pose

    @staticmethod
    def _apart_m(points: FloatArray, pose: FloatArray, other: FloatArray) -> float:
        """By how far two poses put the points apart, in the median."""
        return float(np.median(np.linalg.norm(se3.transform(pose, points) - se3.transform(other, points), axis=1)))

    def _share(self, points: FloatArray, pose: FloatArray) -> float:
        some = se3.transform(pose, points[:: max(1, len(points) // _POINTS)])
        return float(np.mean(np.any([scan.occupied.holds(some) for scan in self._last], axis=0)))

    def _searched(self, expected: FloatArray) -> list[FloatArray]:
        """Poses at which the scan fits the last ones, from standing still, turned all around, and from the expected."""
        gicp, last_pose = CoarseToFineGicp(), self._last[-1].pose
        together = [se3.transform(se3.between(last_pose, scan.pose), scan.points) for scan in self._last]
        last, now = (
            PreparedCloud.of(np.asarray(cloud, np.float32), gicp.voxel_sizes_m(self._voxel_m / 2), num_threads=1)
            for cloud in (np.concatenate(together), self._thinned())
        )
        starts = np.concatenate([around_scan_context(None, _TURNS), se3.between(last_pose, expected)[None]])
        results = gicp.measure(last, now, starts, RegistrationSettings())
        return [np.asarray(last_pose @ result.T_query_match) for result in results]
