"""Floor plans of which it is known how they may lie over each other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.frontends.registration.floor_plans import all_ways, other_ways, standing_points
from wiclosure.types import FloatArray

VOXEL_M = 0.25


def outline(corners: list[tuple[float, float]]) -> FloatArray:
    """Points along walls from corner to corner, and back to the first."""
    ends = np.array([*corners, corners[0]])
    walls = [start + np.linspace(0.0, 1.0, 400)[:, None] * (end - start) for start, end in pairwise(ends)]
    flat = np.concatenate(walls)
    return np.column_stack([flat, np.ones(len(flat))])


ROOM = outline([(0, 0), (20, 0), (20, 9), (11, 9), (11, 14), (0, 14)])
HALL = outline([(-10, -6), (10, -6), (10, 6), (-10, 6)])


@settings(max_examples=15, deadline=None)
@given(st.floats(-3.1, 3.1), st.floats(-30, 30), st.floats(-30, 30))
def test_a_map_is_laid_over_itself_however_it_was_moved(yaw_rad: float, x_m: float, y_m: float) -> None:
    moved = se3.from_yaw(yaw_rad, np.array([x_m, y_m, 0.0]))
    best = all_ways(ROOM, se3.transform(moved, ROOM), VOXEL_M)[0]
    assert best.share > 0.95
    assert np.linalg.norm(se3.transform(best.T @ moved, ROOM) - ROOM, axis=1).max() < 1.5


def test_a_hall_fits_turned_by_half_a_turn() -> None:
    place = np.array([3.0, -7.0, 0.0])
    hall = se3.transform(se3.from_yaw(0.4, place), HALL)
    ways = other_ways(hall, hall, VOXEL_M)
    about_its_middle = se3.transform(ways[0].T, place)
    assert abs(np.degrees(se3.yaw(ways[0].T))) == pytest.approx(180, abs=4)
    assert np.linalg.norm(about_its_middle - place) < 1.0
    assert ways[0].share > 0.95


def test_a_room_with_a_corner_missing_fits_one_way_only() -> None:
    assert other_ways(ROOM, ROOM, VOXEL_M) == []


def test_a_wall_through_the_middle_has_as_much_room_on_either_side() -> None:
    wall = outline([(-10, 0), (10, 0)])
    aside = wall + np.where(wall[:, :1] < 0, 1, -1) * [0.0, 2 * VOXEL_M, 0.0]  # by one cell, to one side and the other
    ways = all_ways(np.concatenate([HALL, wall]), np.concatenate([HALL, aside]), VOXEL_M)
    assert ways[0].share == pytest.approx(1.0)


def test_a_row_of_equal_pillars_fits_a_pillar_further_on() -> None:
    pillars = [outline([(x, 1.0), (x + 0.5, 1.0), (x + 0.5, 1.5), (x, 1.5)]) for x in np.arange(0.0, 60.0, 5.0)]
    row = np.concatenate(pillars)
    shifts = {
        round(float(way.T[0, 3]) / 5.0)
        for way in other_ways(row, row, VOXEL_M)
        if abs(se3.yaw(way.T)) < 0.01 and abs(way.T[0, 3] % 5.0 - 2.5) > 1.9
    }
    assert shifts == {-1, 1}


def test_without_points_nothing_fits() -> None:
    assert all_ways(np.zeros((0, 3)), HALL, VOXEL_M) == []
    assert other_ways(HALL, np.zeros((0, 3)), VOXEL_M) == []


def test_the_ground_is_no_part_of_a_plan() -> None:
    ground = np.stack(np.meshgrid(np.arange(-8, 8, 0.2), np.arange(-8, 8, 0.2), [0.0]), axis=-1).reshape(-1, 3)
    wall = np.stack(np.meshgrid(np.arange(-8, 8, 0.2), [5.0], np.arange(0.5, 3.0, 0.2)), axis=-1).reshape(-1, 3)
    there = se3.from_yaw(np.pi / 2, np.array([100.0, 0.0, 0.0]))
    standing = standing_points([np.concatenate([ground, wall]).astype(np.float32)], there[None], VOXEL_M)
    assert len(standing) > 500
    assert np.abs(standing[:, 0] - 95.0).max() < 0.3
