from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.merged.map_writers import write_pcd, write_ply
from wiclosure.backends.merged.merged_map import MergedMap
from wiclosure.errors import OutputError

EMPTY = MergedMap(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint8))
WRITERS = {"ply": write_ply, "pcd": write_pcd}


@pytest.mark.parametrize("kind", list(WRITERS))
@pytest.mark.parametrize("coloured", [False, True])
def test_it_reads_back_in_another_library(tmp_path, kind, coloured):
    import open3d as o3d

    rng = np.random.default_rng(1)
    merged = MergedMap(
        rng.normal(0, 50, (1000, 3)).astype(np.float32),
        rng.integers(0, 256, (1000, 3)).astype(np.uint8),
        rng.uniform(0, 255, 1000).astype(np.float32) if coloured else None,
    )
    path = tmp_path / f"map.{kind}"
    WRITERS[kind](merged, path)
    read = o3d.io.read_point_cloud(str(path))
    np.testing.assert_array_equal(np.asarray(read.points).astype(np.float32), merged.points)
    np.testing.assert_array_equal((np.asarray(read.colors) * 255).round(), merged.colours)
    table = o3d.t.io.read_point_cloud(str(path)).point
    assert ("intensity" in table) == coloured
    if coloured:
        np.testing.assert_array_equal(table["intensity"].numpy().ravel(), merged.intensity)


@pytest.mark.parametrize(("kind", "header"), [("ply", b"element vertex 0\n"), ("pcd", b"POINTS 0\n")])
def test_an_empty_map_is_a_file_without_points(tmp_path, kind, header):
    WRITERS[kind](EMPTY, tmp_path / "map")
    assert header in (tmp_path / "map").read_bytes()


@pytest.mark.parametrize("kind", list(WRITERS))
def test_a_missing_folder_is_named(tmp_path, kind):
    with pytest.raises(OutputError, match="nowhere"):
        WRITERS[kind](EMPTY, tmp_path / "nowhere" / "map")
