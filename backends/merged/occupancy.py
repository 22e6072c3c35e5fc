"""The merged map seen from above: where a robot may drive, as ROS map_server reads it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, median_filter

from wiclosure.backends.config import MapSettings
from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.errors import OutputError
from wiclosure.types import FloatArray

OCCUPIED, UNKNOWN, FREE = 0, 205, 254  # the grey values that map_saver writes
GROUND_SQUARE = 4  # pixels on a side in which one height is the ground's: a tenth of a metre off on a slope of 10 %
GROUND_QUANTILE = 0.1
SQUARES_AROUND = 5  # on a side: ground is seen beside every obstacle but the widest
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
    """Obstacles, free ground and the rest, by height above the ground around."""
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
    height = z - _ground((xy - origin) / (GROUND_SQUARE * cell_m), z)
    obstacle = (height >= settings.obstacle_min_m) & (height <= settings.obstacle_max_m)
    hits = np.zeros(shape, np.int32)
    np.add.at(hits, (rows[obstacle], columns[obstacle]), 1)
    pixels = np.full(shape, UNKNOWN, np.uint8)
    low = height < settings.obstacle_min_m
    pixels[rows[low], columns[low]] = FREE
    pixels[hits >= VOXELS_OF_OBSTACLE] = OCCUPIED
    return OccupancyGrid(pixels[::-1], cell_m, origin)


def _ground(xy: FloatArray, z: FloatArray) -> FloatArray:
    """Height of the ground at each point `(N,)`: a low point of its square, made median over the squares around.

    Positions `xy (N, 2)` are in squares.  The lowest point itself is often below the ground: an echo's, or that of a
    pass that drift has put lower.
    """
    square = np.floor(xy).astype(np.int64)
    shape = tuple(square.max(axis=0) + 1)
    number = np.ravel_multi_index(tuple(square.T), shape)
    order = np.lexsort((z, number))
    first = np.flatnonzero(np.diff(number[order], prepend=-1))
    count = np.diff(first, append=len(z))
    low = z[order][first + (GROUND_QUANTILE * count).astype(np.int64)]
    seen, heights = np.zeros(shape, bool), np.zeros(shape)
    seen.flat[number[order][first]], heights.flat[number[order][first]] = True, low
    nearest = distance_transform_edt(~seen, return_distances=False, return_indices=True)
    return np.asarray(median_filter(heights[tuple(nearest)], size=SQUARES_AROUND)[tuple(square.T)])


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
            f"cannot write the occupancy grid in {folder}: {error.strerror}; choose another folder with --out"
        ) from error
