"""Paths with one mirror reflection; the simulated measurements over them are tested in test_radio.py."""

from __future__ import annotations

import numpy as np

from wiclosure.simulation.sensors.propagation import InScene, Unobstructed, mirror
from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.mesh import box
from wiclosure.simulation.world.scene import Footprint, Reflector, Scene, SceneBuilder

RECEIVER, TRANSMITTER = np.array([[0.0, 0.0, 1.0]]), np.array([[8.0, 0.0, 1.0]])


def scene(*, block: bool) -> Scene:
    """A wall along y = 6, and a block between it and the antennas."""
    builder = SceneBuilder(rough_ground(np.random.default_rng(0), (-40.0, -40.0), (40.0, 40.0), 0.0))
    builder.building(box(30.0, 0.5, 5.0), Footprint(30.0, 0.5, 5.0), 0.0, 6.25)
    if block:
        builder.stand(box(1.0, 1.0, 5.0), 2.0, 3.0)
    return builder.build()


def test_a_wall_shows_the_transmitter_behind_it() -> None:
    found = InScene(scene(block=False)).reflections(RECEIVER, TRANSMITTER)
    assert found.transmission.tolist() == [0]
    np.testing.assert_allclose(found.virtual_m, [[8.0, 12.0, 1.0]], atol=1e-9)


def test_both_legs_must_be_free() -> None:
    assert len(InScene(scene(block=True)).reflections(RECEIVER, TRANSMITTER).transmission) == 0


def test_a_wall_between_the_antennas_blocks_and_does_not_mirror() -> None:
    propagation, behind = InScene(scene(block=False)), np.array([[8.0, 20.0, 1.0]])
    assert propagation.blocked(RECEIVER, np.array([[8.0, 0.0, 1.0]])).tolist() == [False]
    assert propagation.blocked(RECEIVER, behind).tolist() == [True]
    assert len(propagation.reflections(RECEIVER, behind).transmission) == 0


def test_a_reflection_beside_or_above_the_wall_does_not_exist() -> None:
    propagation = InScene(scene(block=False))
    for shift_m in np.array([[60.0, 0.0, 0.0], [0.0, 0.0, 9.0]]):
        assert len(propagation.reflections(RECEIVER + shift_m, TRANSMITTER + shift_m).transmission) == 0


def test_a_mirror_image_lies_as_far_behind_the_plane() -> None:
    wall = Reflector(np.array([0.0, 0.0]), np.array([3.0, 3.0]), 0.0, 5.0)
    np.testing.assert_allclose(mirror(wall, np.array([[2.0, 0.0, 1.0]])), [[0.0, 2.0, 1.0]], atol=1e-12)


def test_nothing_is_in_the_way_in_free_space() -> None:
    assert Unobstructed().blocked(RECEIVER, TRANSMITTER).tolist() == [False]
    assert Unobstructed().reflections(RECEIVER, TRANSMITTER).virtual_m.shape == (0, 3)
