"""Free space that a scan proves: the test that tells look-alike places apart.

Two clouds of repetitive surroundings fit each other under many poses, and what one shows and the other lacks proves
nothing: it may be hidden, or out of range.  But where the rays of one sensor end well behind a point of the other,
nothing can stand there, and the pose is wrong: a free-space conflict.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from wiclosure.types import FloatArray

_RAYS = 5  # looked at around each direction
_FEWEST_RAYS = 3  # of them near enough to say anything
_NEAR_VOXELS, _NEAR_RAD = 2.0, 0.02
_PAST_VOXELS, _PAST_SHARE = 2.0, 0.05


@dataclass(frozen=True, slots=True, eq=False)
class FreeSpace:
    """The space that the rays of one scan passed, by direction.

    Args:
        directions: search tree of the directions' unit vectors.
        ranges_m: `(N,)` how far each ray went.
        voxel_m: how finely the cloud is thinned: rays go that far apart where they hit.
    """

    directions: Any
    ranges_m: FloatArray
    voxel_m: float

    @classmethod
    def of(cls, points: FloatArray, voxel_m: float) -> Self:
        """From a cloud `(N, 3)` of a single scan, seen from the origin."""
        ranges_m = np.maximum(np.linalg.norm(points, axis=1), 1e-6)
        return cls(cKDTree(points / ranges_m[:, None]), ranges_m, voxel_m)

    def conflicts(self, points: FloatArray) -> NDArray[np.bool_]:
        """Which of the points `(M, 3)` lie where the sensor saw free space.

        Every ray near the point's direction, and there must be three, ends well behind it.
        """
        ranges_m = np.maximum(np.linalg.norm(points, axis=1), 1e-6)
        apart, ray = self.directions.query(points / ranges_m[:, None], _RAYS)
        near = apart < np.maximum(_NEAR_VOXELS * self.voxel_m / ranges_m, _NEAR_RAD)[:, None]
        # Rays that the tree did not find have an infinite distance and an index beyond the last.
        ends_m = np.append(self.ranges_m, np.inf)[ray]
        nearest_end_m = np.where(near, ends_m, np.inf).min(axis=1)
        behind_m = ranges_m + np.maximum(_PAST_VOXELS * self.voxel_m, _PAST_SHARE * ranges_m)
        return np.asarray((near.sum(axis=1) >= _FEWEST_RAYS) & (nearest_end_m > behind_m))
