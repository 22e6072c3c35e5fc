"""The merged map: the keyframes' clouds in one frame, one point per voxel, coloured by robot.

Voxels are gathered by tiles of ground.  When too many are in memory, all tiles go to a temporary folder, and come back
one at a time when the map is finished: memory is bounded by one tile and by the finished points, 15 bytes each.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from wiclosure.backends.config import MapSettings
from wiclosure.colours import robot_rgb
from wiclosure.errors import InputError
from wiclosure.scratch import temporary_folder
from wiclosure.types import Float32Array, FloatArray

VOXELS_IN_MEMORY = 2_000_000  # some 130 MB
TILE_BITS = 9  # a tile is 512 voxels wide: 100 m at 0.2 m
AXIS_BITS = 21  # three voxel coordinates in one int64: 200 km each way at 0.2 m
TILE_SHIFT = 2 * TILE_BITS + AXIS_BITS
VoxelKeys: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, slots=True, eq=False)
class MergedMap:
    """A point cloud in the world frame.

    Args:
        points: `(N, 3)` float32, metres: the mean of each voxel's points.
        colours: `(N, 3)` uint8: the mean of its robots' colours, so that places that several robots saw are mixed.
        intensity: `(N,)` float32 in the sensors' own unit, the mean likewise, NaN where it is not known; or None.
    """

    points: Float32Array
    colours: NDArray[np.uint8]
    intensity: Float32Array | None = None

    def __repr__(self) -> str:
        return f"MergedMap({len(self)} points)"

    def __len__(self) -> int:
        return len(self.points)


def merge_maps(clouds: Iterable[tuple[int, FloatArray, Float32Array]], settings: MapSettings) -> MergedMap:
    """Merges clouds one after the other; sums of voxels are kept by tiles, on disk if there are too many.

    Args:
        clouds: the robot's number (its colour), `T_world_body (4, 4)` and points `(N, 3)` in the body's axes; or
            `(N, 4)` with the intensity last, for all clouds alike.
        settings: see `MapSettings`.

    Raises:
        InputError: the map is too wide for its voxels.
    """
    with temporary_folder() as folder:
        tiles = _Tiles(settings.voxel_size_m, folder)
        for robot, T_world_body, points in clouds:
            tiles.add(robot, T_world_body, points)
        return tiles.merged()


class _Tiles:
    """Sums of positions and colours by voxel; a tile's parts are added up when there are many, or at the end."""

    def __init__(self, size_m: float, folder: Path) -> None:
        self.size_m = size_m
        self.folder = folder
        self.parts: dict[int, list[tuple[VoxelKeys, FloatArray]]] = {}
        self.in_memory = 0

    def add(self, robot: int, T_world_body: FloatArray, points: FloatArray | Float32Array) -> None:
        points = points[np.isfinite(points[:, :3]).all(axis=1)].astype(float)
        world = points[:, :3] @ T_world_body[:3, :3].T + T_world_body[:3, 3]
        rows = np.empty((len(world), 4 + points.shape[1]))  # x, y, z, red, green, blue, count; intensity where known
        rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7:] = world, robot_rgb(robot), 1.0, points[:, 3:]
        # One cloud is thinned at once: what waits is then a few thousand voxels, not a hundred thousand points.
        keys, rows = _summed(self._keys(world), rows)
        starts = np.flatnonzero(np.diff(keys >> TILE_SHIFT, prepend=-1))
        for first, last in pairwise([*starts.tolist(), len(keys)]):
            tile = int(keys[first] >> TILE_SHIFT)
            self.parts.setdefault(tile, []).append((keys[first:last], rows[first:last]))
        self.in_memory += len(keys)
        if self.in_memory > VOXELS_IN_MEMORY:
            self._make_room()

    def merged(self) -> MergedMap:
        """All tiles, each in memory alone, in a fixed order."""
        on_disk = {int(path.name.split("-")[0]) for path in self.folder.iterdir()}
        points, colours = [np.zeros((0, 3), np.float32)], [np.zeros((0, 3), np.uint8)]
        intensity: list[Float32Array] = []
        for tile in sorted(self.parts.keys() | on_disk):
            spilt = [np.load(path) for path in sorted(self.folder.glob(f"{tile}-*.npz"))]
            parts = [(part["keys"], part["sums"]) for part in spilt] + self.parts.pop(tile, [])
            _, sums = _added_up(parts)
            mean = sums[:, :6] / sums[:, 6:7]
            points.append(mean[:, :3].astype(np.float32))
            colours.append(mean[:, 3:].round().astype(np.uint8))
            if sums.shape[1] > 7:
                intensity.append((sums[:, 7] / sums[:, 6]).astype(np.float32))
        known = np.concatenate(intensity) if intensity else None
        return MergedMap(np.concatenate(points), np.concatenate(colours), known)

    def _make_room(self) -> None:
        """Adds up what lies in the same voxels; if that does not halve it, everything goes to disk."""
        self.parts = {tile: [_added_up(parts)] for tile, parts in self.parts.items()}
        self.in_memory = sum(len(keys) for ((keys, _),) in self.parts.values())
        if self.in_memory <= VOXELS_IN_MEMORY // 2:
            return
        number = len(list(self.folder.iterdir()))
        for tile, ((keys, sums),) in self.parts.items():
            np.savez(self.folder / f"{tile}-{number:09d}.npz", keys=keys, sums=sums)
        self.parts, self.in_memory = {}, 0

    def _keys(self, world: FloatArray) -> VoxelKeys:
        """Tile, then the place in it: the high bits of x and y, then their low bits and z."""
        limit = 1 << (AXIS_BITS - 1)
        cell = np.floor(world / self.size_m)
        if len(cell) and np.abs(cell).max() >= limit:
            raise InputError(
                f"the map reaches {np.abs(world).max():.0f} m from its origin, too far for voxels of {self.size_m:g} m;"
                " set map.voxel_size_m higher, or check the trajectories"
            )
        x, y, z = (cell.astype(np.int64) + limit).T
        inside = (1 << TILE_BITS) - 1
        tile = ((x >> TILE_BITS) << (AXIS_BITS - TILE_BITS)) | (y >> TILE_BITS)
        place = ((x & inside) << TILE_BITS) | (y & inside)
        return np.asarray((tile << TILE_SHIFT) | (place << AXIS_BITS) | z)


def _added_up(parts: Sequence[tuple[VoxelKeys, FloatArray]]) -> tuple[VoxelKeys, FloatArray]:
    return _summed(np.concatenate([keys for keys, _ in parts]), np.concatenate([sums for _, sums in parts]))


def _summed(keys: VoxelKeys, rows: FloatArray) -> tuple[VoxelKeys, FloatArray]:
    """Rows of equal keys added up, sorted by key."""
    if len(keys) == 0:
        return keys, rows
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    first = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    return keys[first], np.add.reduceat(rows[order], first, axis=0)
