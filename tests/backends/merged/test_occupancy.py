from __future__ import annotations

import numpy as np
import pytest
import yaml

from wiclosure.backends.config import MapSettings
from wiclosure.backends.merged import occupancy as module
from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.backends.merged.occupancy import FREE, OCCUPIED, UNKNOWN, occupancy, write_occupancy
from wiclosure.errors import OutputError


def map_of(points):
    points = np.asarray(points, np.float32)
    return MergedMap(points, np.zeros((len(points), 3), np.uint8))


def pixel(grid, x, y):
    column, row = np.floor((np.array([x, y]) - grid.origin_xy) / grid.cell_m).astype(int)
    return grid.pixels[len(grid.pixels) - 1 - row, column]


@pytest.fixture
def scene():
    """A slope of 30 x 10 m from (100, -20) with a wall across it, a bridge above it, and a stray point."""
    x, y = np.meshgrid(np.arange(100.05, 130, 0.2), np.arange(-20, -10, 0.2))
    ground = np.stack([x.ravel(), y.ravel(), 0.1 * (x.ravel() - 100)], axis=1)
    across = np.arange(-20, -10, 0.2)
    wall = [(110.1, v, 1.0 + h) for v in across for h in np.arange(0.2, 3, 0.2)]
    bridge = [(u, -15.1, 8.0) for u in np.arange(100.05, 130, 0.2)]
    return map_of([*ground, *wall, *bridge, (120.1, -12.1, 3.2)])


def test_walls_are_occupied_ground_is_free_and_bridges_are_driven_below(scene):
    grid = occupancy(scene, MapSettings())
    assert pixel(grid, 110.1, -18.0) == OCCUPIED
    assert pixel(grid, 105.1, -18.0) == pixel(grid, 125.1, -15.1) == pixel(grid, 120.1, -12.1) == FREE
    assert (grid.pixels == OCCUPIED).mean() < 0.02


def test_what_nobody_saw_is_unknown():
    far = [(x + 50, 30.0, 0.0) for x in (0.1, 0.3)]
    grid = occupancy(map_of([(0.1, 0.1, 0.0), *far]), MapSettings())
    assert pixel(grid, 25.0, 15.0) == UNKNOWN
    assert (grid.pixels == FREE).sum() == 3


def test_the_files_are_what_map_server_reads(scene, tmp_path):
    grid = occupancy(scene, MapSettings(occupancy_cell_m=0.5))
    write_occupancy(grid, tmp_path)
    described = yaml.safe_load((tmp_path / "occupancy.yaml").read_text())
    assert described == {
        "image": "occupancy.pgm", "mode": "trinary", "resolution": 0.5, "origin": [*grid.origin_xy.tolist(), 0.0],
        "negate": 0, "occupied_thresh": 0.65, "free_thresh": 0.196,
    }  # fmt: skip
    kind, size, levels, pixels = (tmp_path / "occupancy.pgm").read_bytes().split(b"\n", 3)
    assert (kind, levels) == (b"P5", b"255")
    columns, rows = map(int, size.split())
    assert (rows, columns) == grid.pixels.shape
    assert pixels == grid.pixels.tobytes()


def test_huge_maps_get_wider_pixels_and_empty_ones_a_single_unknown_one(monkeypatch):
    monkeypatch.setattr(module, "MAX_CELLS", 1000)
    grid = occupancy(map_of([(0, 0, 0), (100, 100, 0)]), MapSettings())
    assert grid.pixels.size < 1200
    assert occupancy(map_of(np.zeros((0, 3))), MapSettings()).pixels.tolist() == [[UNKNOWN]]


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(OutputError, match="nowhere"):
        write_occupancy(occupancy(map_of([(0, 0, 0)]), MapSettings()), tmp_path / "nowhere")
