from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.config import MapSettings
from wiclosure.backends.merged import merged_map
from wiclosure.backends.merged.merged_map import merge_maps
from wiclosure.colours import ROBOT_COLOURS
from wiclosure.errors import InputError

HALF_METRE = MapSettings(voxel_size_m=0.5)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), in_memory=st.sampled_from([1, 300, 10**6]), tile_bits=st.sampled_from([2, 9]))
def test_every_voxel_has_the_mean_of_its_points_whatever_goes_to_disk_when(seed, in_memory, tile_bits):
    rng = np.random.default_rng(seed)
    poses = se3.from_yaw(rng.uniform(-3, 3, 5), rng.normal(0, 5, (5, 3)))
    clouds = rng.normal(0, 2, (5, 200, 3)).astype(np.float32)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(merged_map, "VOXELS_IN_MEMORY", in_memory)
        patch.setattr(merged_map, "TILE_BITS", tile_bits)
        patch.setattr(merged_map, "TILE_SHIFT", 2 * tile_bits + merged_map.AXIS_BITS)
        merged = merge_maps(zip([0] * 5, poses, clouds, strict=True), HALF_METRE)
    world = np.einsum("kij,knj->kni", poses[:, :3, :3], clouds.astype(float)) + poses[:, None, :3, 3]
    cells, inverse, counts = np.unique(
        np.floor(world.reshape(-1, 3) / 0.5), axis=0, return_inverse=True, return_counts=True
    )
    means = np.zeros((len(cells), 3))
    np.add.at(means, inverse.ravel(), world.reshape(-1, 3))
    assert len(merged) == len(cells)
    np.testing.assert_allclose(np.sort(merged.points, axis=0), np.sort(means / counts[:, None], axis=0), atol=1e-5)
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
        patch.setattr(merged_map, "VOXELS_IN_MEMORY", 20_000)
        assert peak(40) < 1.2 * peak(10)


@pytest.mark.parametrize("clouds", [[], [(0, np.eye(4), np.zeros((0, 3), np.float32))]])
def test_no_points_make_an_empty_map(clouds):
    merged = merge_maps(clouds, HALF_METRE)
    assert len(merged) == 0


def test_intensity_is_the_mean_of_a_voxel_and_unknown_where_one_of_its_clouds_tells_none():
    first = np.array([[0.1, 0.1, 0.1, 10.0], [3.1, 0.1, 0.1, 70.0]], np.float32)
    second = np.array([[0.2, 0.1, 0.1, 30.0], [3.2, 0.1, 0.1, np.nan], [6.1, 0.1, 0.1, 5.0]], np.float32)
    merged = merge_maps([(0, np.eye(4), first), (1, np.eye(4), second)], HALF_METRE)
    assert merged.intensity is not None
    order = np.argsort(merged.points[:, 0])
    np.testing.assert_allclose(merged.intensity[order], [20.0, np.nan, 5.0])
    assert merge_maps([(0, np.eye(4), first[:, :3])], HALF_METRE).intensity is None


def test_points_that_are_not_finite_are_left_out():
    cloud = np.array([[1, 2, 3], [np.nan, 0, 0], [np.inf, 0, 0]], np.float32)
    np.testing.assert_allclose(merge_maps([(0, np.eye(4), cloud)], HALF_METRE).points, [[1, 2, 3]])


def test_a_map_too_wide_for_its_voxels_is_refused():
    with pytest.raises(InputError, match=r"map\.voxel_size_m"):
        merge_maps([(0, se3.from_yaw(0.0, np.array([1e7, 0.0, 0.0])), np.zeros((1, 3), np.float32))], HALF_METRE)


def test_memory_of_a_growing_map_is_bounded_by_what_is_kept_and_what_is_finished():
    rng = np.random.default_rng(0)

    def peak(scans):
        clouds = (
            (0, se3.from_yaw(0.0, np.array([40.0 * n, 0, 0])), rng.uniform(0, 40, (20_000, 3))) for n in range(scans)
        )
        tracemalloc.start()
        merged = merge_maps(((r, T, cloud.astype(np.float32)) for r, T, cloud in clouds), HALF_METRE)
        peak_bytes = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak_bytes - 2 * (merged.points.nbytes + merged.colours.nbytes)  # as parts, then as one

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(merged_map, "VOXELS_IN_MEMORY", 50_000)
        assert peak(50) < 1.2 * peak(14)  # a tile is six clouds wide
