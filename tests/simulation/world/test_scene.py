"""What stands where, and what rays and radio meet."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.mesh import box, pole
from wiclosure.simulation.world.scene import Footprint, Scene, SceneBuilder


@pytest.fixture
def scene() -> Scene:
    """Flat ground; a building of 10 x 4 x 5 m at (20, 0), turned by 90 degrees; a pole at (10, 0)."""
    builder = SceneBuilder(rough_ground(np.random.default_rng(0), (-40.0, -40.0), (40.0, 40.0), 0.0))
    builder.building(box(10.0, 4.0, 5.0), Footprint(10.0, 4.0, 5.0), 20.0, 0.0, np.pi / 2)
    builder.plant(pole(6.0, 0.2), 10.0, 0.0)
    return builder.build()


def test_a_building_mirrors_with_all_faces_that_are_long_enough(scene: Scene) -> None:
    corners = {tuple(np.round(wall.start_m, 6)) for wall in scene.reflectors}
    assert corners == {(18.0, -5.0), (22.0, -5.0), (22.0, 5.0), (18.0, 5.0)}
    assert {(wall.low_m, wall.high_m) for wall in scene.reflectors} == {(0.0, 5.0)}
    lengths = sorted(float(np.linalg.norm(wall.end_m - wall.start_m)) for wall in scene.reflectors)
    np.testing.assert_allclose(lengths, [4, 4, 10, 10])


def test_short_faces_scatter_and_do_not_mirror() -> None:
    builder = SceneBuilder(rough_ground(np.random.default_rng(0), (-9.0, -9.0), (9.0, 9.0), 0.0))
    builder.building(box(6.0, 1.0, 3.0), Footprint(6.0, 1.0, 3.0), 0.0, 0.0)
    assert len(builder.build().reflectors) == 2


def test_rays_hit_what_comes_first(scene: Scene) -> None:
    towards = {"pole": (0, 0, 1, 1, 0, 0), "beside": (0, 2, 1, 1, 0, 0), "down": (0, 0, 1, 0, 0, -1)}
    hits = scene.cast(np.array([*towards.values(), (0, 0, 1, 0, 0, 1)], np.float32))
    np.testing.assert_allclose(hits.distance_m[:3], [9.8, 18.0, 1.0], atol=0.02)
    assert np.isinf(hits.distance_m[3])
    assert hits.cosine[1] == pytest.approx(1.0, abs=1e-5)


def test_radio_bends_around_poles_and_not_around_buildings(scene: Scene) -> None:
    start = np.array([[0.0, 0, 1], [0.0, 0, 1], [0.0, 0, 8]])
    end = np.array([[15.0, 0, 1], [30.0, 0, 1], [30.0, 0, 8]])
    assert scene.obstacles(start, end).tolist() == [0, 2, 0]
    assert scene.obstacles(np.zeros((0, 3)), np.zeros((0, 3))).tolist() == []


def test_another_process_gets_the_same_scene_without_the_ray_caster(scene: Scene) -> None:
    rays = np.array([(0, 2, 1, 1, 0, 0)], np.float32)
    before = scene.cast(rays)
    copy = pickle.loads(pickle.dumps(scene))
    assert "_raycaster" not in vars(copy)
    np.testing.assert_array_equal(copy.cast(rays).distance_m, before.distance_m)
