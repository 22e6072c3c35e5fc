"""The merged map: the keyframes' clouds in one frame, one point a voxel, coloured by robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wiclosure.backends.config import MapSettings
from wiclosure.errors import InputError, OutputError
from wiclosure.types import Float32Array, FloatArray

# Okabe and Ito's palette: told apart with every kind of colour vision.
ROBOT_COLOURS = np.array(
    [(0, 114, 178), (230, 159, 0), (0, 158, 115), (204, 121, 167), (86, 180, 233), (213, 94, 0), (240, 228, 66)],
    dtype=np.uint8,
)
PENDING_POINTS = 2_000_000  # points gathered before they are merged into voxels: some 100 MB
AXIS_BITS = 21  # three voxel coordinates in one int64: 200 km each way at 0.2 m
PLY_VERTEX = np.dtype([("xyz", "<f4", 3), ("rgb", "u1", 3)])


@dataclass(frozen=True, slots=True, eq=False)
class MergedMap:
    """A point cloud in the world frame.

    Args:
        points: `(N, 3)` float32, metres: the mean of each voxel's points.
        colours: `(N, 3)` uint8: the mean of its robots' colours, so that places that several robots saw are mixed.
    """

    points: Float32Array
    colours: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.points)


def merge_maps(clouds: Iterable[tuple[int, FloatArray, Float32Array]], settings: MapSettings) -> MergedMap:
    """Merges clouds one after the other; memory grows with the map's voxels, not with the points.

    Args:
        clouds: the robot's number (its colour), `T_world_body (4, 4)` and points `(N, 3)` in the body's axes.
        settings: see `MapSettings`.

    Raises:
        InputError: the map is too wide for its voxels.
    """
    voxels = _Voxels(settings.voxel_size_m)
    for robot, T_world_body, points in clouds:
        voxels.add(robot, T_world_body, points)
    return voxels.merged()


def write_ply(merged: MergedMap, path: Path) -> None:
    """Writes a binary PLY, float32 points with colours.

    Raises:
        OutputError: the file cannot be written.
    """
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(merged)}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    vertices = np.empty(len(merged), PLY_VERTEX)
    vertices["xyz"], vertices["rgb"] = merged.points, merged.colours
    try:
        with path.open("wb") as file:
            file.write(header.encode("ascii"))
            file.write(vertices.tobytes())
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder with --out") from error


class _Voxels:
    """Sums of positions and colours by voxel, sorted by voxel; new points wait until they are worth a merge."""

    def __init__(self, size_m: float) -> None:
        self.size_m = size_m
        self.keys = np.zeros(0, np.int64)
        self.sums = np.zeros((0, 7))  # x, y, z, red, green, blue, count
        self.pending: list[tuple[NDArray[np.int64], FloatArray]] = []
        self.pending_points = 0

    def add(self, robot: int, T_world_body: FloatArray, points: Float32Array) -> None:
        world = points[np.isfinite(points).all(axis=1)].astype(float) @ T_world_body[:3, :3].T + T_world_body[:3, 3]
        rows = np.empty((len(world), 7))
        rows[:, :3], rows[:, 3:6], rows[:, 6] = world, ROBOT_COLOURS[robot % len(ROBOT_COLOURS)], 1.0
        # One cloud is thinned at once: what waits is then a few thousand voxels, not a hundred thousand points.
        self.pending.append(_summed(self._keys(world), rows))
        self.pending_points += len(self.pending[-1][0])
        if self.pending_points > PENDING_POINTS:
            self._merge()

    def merged(self) -> MergedMap:
        self._merge()
        mean = self.sums[:, :6] / self.sums[:, 6:]
        return MergedMap(mean[:, :3].astype(np.float32), mean[:, 3:].round().astype(np.uint8))

    def _merge(self) -> None:
        keys = [self.keys, *(k for k, _ in self.pending)]
        sums = [self.sums, *(s for _, s in self.pending)]
        self.keys, self.sums = _summed(np.concatenate(keys), np.concatenate(sums))
        self.pending, self.pending_points = [], 0

    def _keys(self, world: FloatArray) -> NDArray[np.int64]:
        limit = 1 << (AXIS_BITS - 1)
        cell = np.floor(world / self.size_m)
        if len(cell) and np.abs(cell).max() >= limit:
            raise InputError(
                f"the map reaches {np.abs(world).max():.0f} m from its origin, too far for voxels of {self.size_m:g} m;"
                " set map.voxel_size_m higher, or check the trajectories"
            )
        x, y, z = (cell.astype(np.int64) + limit).T
        return np.asarray((x << (2 * AXIS_BITS)) | (y << AXIS_BITS) | z)


def _summed(keys: NDArray[np.int64], rows: FloatArray) -> tuple[NDArray[np.int64], FloatArray]:
    """Rows of equal keys added up, sorted by key."""
    if len(keys) == 0:
        return keys, rows
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    first = np.flatnonzero(np.concatenate([[True], keys[1:] != keys[:-1]]))
    return keys[first], np.add.reduceat(rows[order], first, axis=0)
