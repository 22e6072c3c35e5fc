from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.frontends.scale import voxel_size_m


def sphere(radius_m: float) -> np.ndarray:
    points = np.random.default_rng(0).normal(size=(1000, 3))
    return radius_m * points / np.linalg.norm(points, axis=1, keepdims=True)


@pytest.mark.parametrize(("extent_m", "voxel_m"), [(100.0, 1.0), (35.0, 1.0), (18.0, 0.5), (8.0, 0.25), (1.0, 0.125)])
def test_streets_halls_and_rooms(extent_m: float, voxel_m: float) -> None:
    assert voxel_size_m(sphere(extent_m)) == voxel_m


def test_a_few_far_points_do_not_decide() -> None:
    points = sphere(8.0)
    points[:40] *= 20.0
    assert voxel_size_m(points) == 0.25


@given(radius=st.floats(0.0, 1e4))
def test_there_are_four_sizes_and_no_smaller_one_for_larger_surroundings(radius: float) -> None:
    assert voxel_size_m(sphere(radius)) in {0.125, 0.25, 0.5, 1.0}
    assert voxel_size_m(sphere(1.5 * radius)) >= voxel_size_m(sphere(radius))


def test_no_points_take_the_coarsest() -> None:
    assert voxel_size_m(np.zeros((0, 3))) == 1.0
