"""The merged map seen from above: where a robot may drive, as ROS map_server reads it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from wiclosure.backends.config import MapSettings
from wiclosure.backends.merged_map import MergedMap
from wiclosure.errors import OutputError
from wiclosure.types import FloatArray

OCCUPIED, UNKNOWN, FREE = 0, 205, 254  # the grey values that map_saver writes
GROUND_WITHIN_M = 2.0  # ground is the lowest point so near: seen beside every obstacle but the widest
VOXELS_OF_OBSTACLE = 2  # one alone is mostly a stray point
MAX_CELLS = 25_000_000  # 5 x 5 km at 1 m


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyGrid:
    """An image of the ground.

    Args:
        pixels: `(rows, columns)` uint8; the first row is that of the largest y.
        cell_m: width of a pixel.
        origin_xy: `(2,)` metres, outer corner of the lowest pixel on the left.
    """

    pixels: NDArray[np.uint8]
    cell_m: float
    origin_xy: FloatArray


def occupancy(merged: MergedMap, settings: MapSettings) -> OccupancyGrid:
    """Obstacles, free ground and the rest, by height above the lowest point around."""
    if len(merged) == 0:
        return OccupancyGrid(np.full((1, 1), UNKNOWN, np.uint8), settings.occupancy_cell_m, np.zeros(2))
    xy, z = merged.points[:, :2].astype(float), merged.points[:, 2].astype(float)
    low, extent = xy.min(axis=0), np.ptp(xy, axis=0)
    cell_m = max(
        settings.occupancy_cell_m, float(np.sqrt(np.prod(extent) / MAX_CELLS)), float(extent.max()) / MAX_CELLS
    )
    origin = np.floor(low / cell_m) * cell_m
    columns, rows = (np.floor((xy - origin) / cell_m).astype(np.int64)).T
    shape = (int(rows.max()) + 1, int(columns.max()) + 1)
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest, (rows, columns), z)
    ground = minimum_filter(lowest, size=1 + 2 * round(GROUND_WITHIN_M / cell_m), mode="nearest")
    height = z - ground[rows, columns]
    obstacle = (height >= settings.obstacle_min_m) & (height <= settings.obstacle_max_m)
    hits = np.zeros(shape, np.int32)
    np.add.at(hits, (rows[obstacle], columns[obstacle]), 1)
    pixels = np.full(shape, UNKNOWN, np.uint8)
    pixels[lowest < ground + settings.obstacle_min_m] = FREE
    pixels[hits >= VOXELS_OF_OBSTACLE] = OCCUPIED
    return OccupancyGrid(pixels[::-1], cell_m, origin)


def write_occupancy(grid: OccupancyGrid, folder: Path) -> None:
    """Writes `occupancy.pgm` and `occupancy.yaml`: `map_server --yaml occupancy.yaml` serves them.

    Raises:
        OutputError: a file cannot be written.
    """
    rows, columns = grid.pixels.shape
    x, y = grid.origin_xy.tolist()
    yaml = (
        f"image: occupancy.pgm\nmode: trinary\nresolution: {grid.cell_m!r}\norigin: [{x!r}, {y!r}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    try:
        header = f"P5\n{columns} {rows}\n255\n".encode("ascii")
        (folder / "occupancy.pgm").write_bytes(header + np.ascontiguousarray(grid.pixels).tobytes())
        (folder / "occupancy.yaml").write_text(yaml, encoding="ascii")
    except OSError as error:
        raise OutputError(
            f"cannot write {error.filename}: {error.strerror}; choose another folder with --out"
        ) from error
