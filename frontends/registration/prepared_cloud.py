"""Keyframe clouds made ready for registration, and kept for the next closure that needs them."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
import small_gicp

from wiclosure.frontends.registration.free_space import FreeSpace
from wiclosure.types import Float32Array, FloatArray, KeyframeId

NEIGHBOURS = 12  # that tell a point's normal; 20 take a fifth longer and measure no better
LEVEL_GROUND = 0.8


@dataclass(frozen=True, slots=True, eq=False)
class CloudLevel:
    """A cloud at one resolution, with normals, covariances and a search tree (objects of small_gicp)."""

    cloud: Any
    tree: Any

    @property
    def points(self) -> FloatArray:
        """`(N, 3)` points."""
        return np.asarray(self.cloud.points()[:, :3])

    def distances(self, points: FloatArray) -> FloatArray:
        """Distance `(N,)` m of each of the points `(N, 3)` from the nearest of the cloud."""
        _, squared = self.tree.batch_knn_search(points, 1, 1)
        return np.asarray(np.sqrt(np.ravel(squared)), float)


@dataclass(frozen=True, slots=True, eq=False)
class PreparedCloud:
    """A cloud at several resolutions, coarse to fine.

    Args:
        voxel_m: resolution of the finest level.
        levels: coarse to fine.
        structure: `(M, 3)` points of the finest level that are not on level ground or ceiling.  Ground looks like
            ground everywhere: it matches under any shift and would drown what tells places apart.
        free_space: where nothing can stand, as rays passed there.
    """

    voxel_m: float
    levels: tuple[CloudLevel, ...]
    structure: FloatArray
    free_space: FreeSpace

    @classmethod
    def of(cls, cloud: Float32Array, voxel_sizes_m: tuple[float, ...], num_threads: int) -> Self:
        """Prepares a cloud `(N, 3)` in the body's axes."""
        points = np.asarray(cloud, np.float64)
        levels = tuple(
            CloudLevel(*small_gicp.preprocess_points(points, size, num_neighbors=NEIGHBOURS, num_threads=num_threads))
            for size in voxel_sizes_m
        )
        upright = np.abs(np.asarray(levels[-1].cloud.normals())[:, 2]) < LEVEL_GROUND
        return cls(voxel_sizes_m[-1], levels, levels[-1].points[upright], FreeSpace.of(points, voxel_sizes_m[-1]))


class PreparedClouds:
    """The most recently used prepared clouds, at most `capacity` of them."""

    def __init__(self, capacity: int, num_threads: int) -> None:
        self._capacity = capacity
        self._num_threads = num_threads
        self._kept: OrderedDict[tuple[KeyframeId, tuple[float, ...]], tuple[Float32Array, PreparedCloud]] = (
            OrderedDict()
        )

    def get(self, key: KeyframeId, cloud: Float32Array, voxel_sizes_m: tuple[float, ...]) -> PreparedCloud:
        """The prepared cloud of a keyframe; made if it is not at hand, or was made of another array."""
        entry = self._kept.pop((key, voxel_sizes_m), None)
        if entry is None or entry[0] is not cloud:
            entry = (cloud, PreparedCloud.of(cloud, voxel_sizes_m, self._num_threads))
        self._kept[key, voxel_sizes_m] = entry
        if len(self._kept) > self._capacity:
            self._kept.popitem(last=False)
        return entry[1]
