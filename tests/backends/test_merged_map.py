from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends import merged_map
from wiclosure.backends.config import MapSettings
from wiclosure.backends.merged_map import ROBOT_COLOURS, MergedMap, merge_maps, write_ply
from wiclosure.errors import InputError, OutputError

HALF_METRE = MapSettings(voxel_size_m=0.5)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), pending=st.sampled_from([1, 300, 10**6]))
def test_streaming_gives_the_mean_of_each_voxel_whatever_is_merged_when(seed, pending):
    rng = np.random.default_rng(seed)
    poses = se3.from_yaw(rng.uniform(-3, 3, 5), rng.normal(0, 5, (5, 3)))
    clouds = rng.normal(0, 2, (5, 200, 3)).astype(np.float32)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(merged_map, "PENDING_POINTS", pending)
        merged = merge_maps(zip([0] * 5, poses, clouds, strict=True), HALF_METRE)
    world = np.einsum("kij,knj->kni", poses[:, :3, :3], clouds.astype(float)) + poses[:, None, :3, 3]
    cells, inverse, counts = np.unique(
        np.floor(world.reshape(-1, 3) / 0.5), axis=0, return_inverse=True, return_counts=True
    )
    means = np.zeros((len(cells), 3))
    np.add.at(means, inverse.ravel(), world.reshape(-1, 3))
    np.testing.assert_allclose(merged.points, means / counts[:, None], atol=1e-5)
    assert (merged.colours == ROBOT_COLOURS[0]).all()


def test_places_that_two_robots_saw_have_mixed_colours():
    point = np.array([[0.1, 0.1, 0.1]], np.float32)
    own = np.array([[9.0, 0.0, 0.0]], np.float32)
    merged = merge_maps([(0, np.eye(4), point), (1, np.eye(4), np.concatenate([point, own]))], HALF_METRE)
    mixed = ROBOT_COLOURS[:2].astype(float).mean(axis=0)
    assert np.abs(merged.colours[0] - mixed).max() <= 0.5
    assert (merged.colours[1] == ROBOT_COLOURS[1]).all()


def test_memory_grows_with_the_map_not_with_the_points():
    cloud = np.random.default_rng(0).uniform(0, 10, (50_000, 3)).astype(np.float32)

    def peak(scans):
        tracemalloc.start()
        merge_maps(((0, np.eye(4), cloud) for _ in range(scans)), HALF_METRE)
        peak_bytes = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak_bytes

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(merged_map, "PENDING_POINTS", 20_000)
        assert peak(40) < 1.2 * peak(10)


@pytest.mark.parametrize("clouds", [[], [(0, np.eye(4), np.zeros((0, 3), np.float32))]])
def test_no_points_make_an_empty_map(clouds, tmp_path):
    merged = merge_maps(clouds, HALF_METRE)
    assert len(merged) == 0
    write_ply(merged, tmp_path / "map.ply")
    assert b"element vertex 0\n" in (tmp_path / "map.ply").read_bytes()


def test_points_that_are_not_finite_are_left_out():
    cloud = np.array([[1, 2, 3], [np.nan, 0, 0], [np.inf, 0, 0]], np.float32)
    np.testing.assert_allclose(merge_maps([(0, np.eye(4), cloud)], HALF_METRE).points, [[1, 2, 3]])


def test_a_map_too_wide_for_its_voxels_is_refused():
    with pytest.raises(InputError, match=r"map\.voxel_size_m"):
        merge_maps([(0, se3.from_yaw(0.0, np.array([1e7, 0.0, 0.0])), np.zeros((1, 3), np.float32))], HALF_METRE)


def test_ply_reads_back_in_another_library(tmp_path):
    import open3d as o3d

    rng = np.random.default_rng(1)
    merged = MergedMap(
        rng.normal(0, 50, (1000, 3)).astype(np.float32), rng.integers(0, 256, (1000, 3)).astype(np.uint8)
    )
    write_ply(merged, tmp_path / "map.ply")
    read = o3d.t.io.read_point_cloud(str(tmp_path / "map.ply"))
    np.testing.assert_array_equal(read.point.positions.numpy(), merged.points)
    np.testing.assert_array_equal(read.point.colors.numpy(), merged.colours)


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(OutputError, match="nowhere"):
        write_ply(merge_maps([], HALF_METRE), tmp_path / "nowhere" / "map.ply")
