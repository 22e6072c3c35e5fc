from __future__ import annotations

import numpy as np
import pytest

from wiclosure.simulation.world.ground import Ground, rough_ground


def ramp() -> Ground:
    """z = 0.1 x + 0.2 y."""
    x, y = np.linspace(-10, 10, 9), np.linspace(-5, 5, 6)
    return Ground(x, y, 0.1 * x[:, None] + 0.2 * y[None])


def test_heights_and_normals_of_a_ramp_are_exact() -> None:
    xy = np.random.default_rng(0).uniform([-10, -5], [10, 5], (50, 2))
    np.testing.assert_allclose(ramp().height(xy), xy @ [0.1, 0.2], atol=1e-12)
    normal = np.array([-0.1, -0.2, 1.0]) / np.sqrt(1.05)
    np.testing.assert_allclose(ramp().normal(xy), np.tile(normal, (50, 1)), atol=1e-12)


def test_the_mesh_covers_the_grid() -> None:
    mesh = ramp().mesh()
    assert len(mesh.triangles) == 2 * 8 * 5
    a, b, c = (mesh.vertices[mesh.triangles[:, k]].astype(float) for k in range(3))
    up = np.cross(b - a, c - a)[:, 2] / 2
    assert up.min() > 0
    assert up.sum() == pytest.approx(20.0 * 10.0)


def test_ground_is_as_rough_as_asked_for_and_follows_its_seed() -> None:
    made = [rough_ground(np.random.default_rng(s), (-300.0, -300.0), (300.0, 300.0), 0.5, 2.5) for s in (0, 0, 1)]
    assert made[0].height_m.std() == pytest.approx(0.5, rel=0.2)
    np.testing.assert_array_equal(made[0].height_m, made[1].height_m)
    assert not np.array_equal(made[0].height_m, made[2].height_m)
    flat = rough_ground(np.random.default_rng(0), (0.0, 0.0), (1.0, 1.0), 0.0)
    assert (flat.height_m.shape, np.ptp(flat.height_m)) == ((4, 4), 0.0)
