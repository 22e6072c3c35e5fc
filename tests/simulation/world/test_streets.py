"""Lots along a street: beside it, not on it, and as alike as asked for."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.motion import GroundPath
from wiclosure.simulation.world.scene import Reflector, SceneBuilder
from wiclosure.simulation.world.streets import KERB_M, LOT_WIDTH_M, line_with_lots


def built(aliasing: float, seed: int = 0) -> tuple[int, tuple[Reflector, ...]]:
    """A straight street of 170 m along x, and its number of lots."""
    ground = rough_ground(np.random.default_rng(0), (-30.0, -60.0), (200.0, 60.0), 0.0)
    builder = SceneBuilder(ground)
    street = GroundPath.through(np.array([[0.0, 0.0], [170.0, 0.0]]), 1.0)
    count = line_with_lots(builder, [street], np.random.default_rng(seed), aliasing)
    return count, builder.build().reflectors


def lengths(walls: tuple[Reflector, ...]) -> set[float]:
    return {round(float(np.linalg.norm(wall.end_m - wall.start_m)), 6) for wall in walls}


def test_a_street_of_copies_has_a_lot_on_every_place() -> None:
    count, walls = built(1.0)
    assert count == 2 * int(170 / LOT_WIDTH_M)
    assert len(walls) == 4 * count
    assert len(lengths(walls)) == 2  # of one house


def test_unique_houses_differ_and_leave_gaps() -> None:
    count, walls = built(0.0)
    assert 12 <= count < 20
    assert len(lengths(walls)) == 2 * count


@pytest.mark.parametrize("aliasing", [0.0, 0.5, 1.0])
def test_no_house_stands_on_the_street(aliasing: float) -> None:
    _, walls = built(aliasing)
    assert min(abs(float(end[1])) for wall in walls for end in (wall.start_m, wall.end_m)) > KERB_M


def test_the_seed_decides() -> None:
    assert lengths(built(0.5)[1]) == lengths(built(0.5)[1]) != lengths(built(0.5, 1)[1])
