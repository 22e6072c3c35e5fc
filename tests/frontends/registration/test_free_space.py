from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.frontends.registration.free_space import FreeSpace
from wiclosure.types import FloatArray


def sphere(radius_m: float, n: int = 4000) -> FloatArray:
    directions = np.random.default_rng(0).normal(size=(n, 3))
    return radius_m * directions / np.linalg.norm(directions, axis=1, keepdims=True)


@given(radius_m=st.floats(3, 40), share=st.floats(0.05, 3.0))
@settings(max_examples=30, deadline=None)
def test_points_well_before_what_was_seen_are_in_conflict_and_others_are_not(radius_m: float, share: float) -> None:
    free = FreeSpace.of(sphere(radius_m), voxel_m=0.05 * radius_m)
    points = sphere(share * radius_m, 50)
    if share < 0.85:
        assert free.conflicts(points).all()
    elif share > 0.95:
        assert not free.conflicts(points).any()


def test_nothing_is_known_where_no_ray_went() -> None:
    half = sphere(20.0)
    free = FreeSpace.of(half[half[:, 0] > 0], voxel_m=0.5)
    assert free.conflicts(np.array([[5.0, 0.0, 0.0]])).all()
    assert not free.conflicts(np.array([[-5.0, 0.0, 0.0]])).any()


def test_a_point_beside_something_near_may_be_hidden_by_it() -> None:
    post = np.column_stack([np.full(20, 4.0), np.zeros(20), np.linspace(-1, 1, 20)])
    free = FreeSpace.of(np.concatenate([sphere(20.0), post]), voxel_m=0.5)
    assert not free.conflicts(np.array([[10.0, 0.1, 0.0]])).any()


def test_a_handful_of_rays_is_no_evidence() -> None:
    assert (
        not FreeSpace.of(np.array([[20.0, 0.0, 0.0], [20.0, 0.1, 0.0]]), voxel_m=0.5)
        .conflicts(np.array([[5.0, 0, 0]]))
        .any()
    )
