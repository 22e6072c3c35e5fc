"""Shapes: their size, and that their surfaces are closed where rays could look in."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from wiclosure.simulation.world.mesh import Mesh, box, bush, car, cylinder, gable, join, pole, tree


def extent(mesh: Mesh) -> np.ndarray:
    return np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])


def area(mesh: Mesh) -> float:
    a, b, c = (mesh.vertices[mesh.triangles[:, k]].astype(float) for k in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def open_edges(mesh: Mesh) -> np.ndarray:
    """Mid-points `(E, 3)` of the edges that belong to one triangle only."""
    pairs = np.sort(mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    once = [pair for pair, count in Counter(map(tuple, pairs.tolist())).items() if count == 1]
    return mesh.vertices[np.array(once, int).reshape(-1, 2)].mean(axis=1)


def test_a_box_stands_on_the_ground_and_is_open_only_below() -> None:
    made = box(4.0, 2.0, 3.0)
    np.testing.assert_allclose(extent(made), [[-2, -1, 0], [2, 1, 3]])
    assert area(made) == pytest.approx(2 * (4 + 2) * 3 + 4 * 2)
    np.testing.assert_allclose(open_edges(made)[:, 2], 0.0)


def test_a_cylinder_approaches_its_surface_with_many_sides() -> None:
    made = cylinder(0.5, 2.0, sides=200)
    assert area(made) == pytest.approx(np.pi * (2 * 0.5 * 2.0 + 0.5**2), rel=1e-3)
    np.testing.assert_allclose(open_edges(made)[:, 2], 0.0)


def test_a_gable_has_its_ridge_along_x() -> None:
    made = gable(6.0, 4.0, 1.5)
    np.testing.assert_allclose(extent(made), [[-3, -2, 0], [3, 2, 1.5]])
    assert area(made) == pytest.approx(2 * 6 * 2.5 + 4 * 1.5)  # two slopes of 2.5 m, two triangles
    np.testing.assert_allclose(open_edges(made)[:, 2], 0.0)


def test_shapes_are_turned_about_z_and_moved() -> None:
    moved = box(4.0, 2.0, 3.0).at(10.0, 20.0, 1.0, np.pi / 2)
    np.testing.assert_allclose(extent(moved), [[9, 18, 1], [11, 22, 4]], atol=1e-6)


def test_joined_shapes_keep_their_triangles() -> None:
    parts = [box(1, 1, 1), cylinder(0.5, 2.0), box(2, 2, 2).at(5, 0)]
    whole = join(parts)
    assert area(whole) == pytest.approx(sum(map(area, parts)))
    assert (len(join([]).vertices), len(join([]).triangles)) == (0, 0)


@pytest.mark.parametrize(
    ("made", "size"),
    [
        (car(4.3, 1.75, 1.45), (4.3, 1.75, 1.45)),
        (pole(6.0, 0.1, 1.5), (1.6, 0.2, 6.0)),
        (pole(6.0, 0.1), (0.2, 0.2, 6.0)),
    ],
)
def test_composed_shapes_have_the_size_asked_for(made: Mesh, size: tuple[float, ...]) -> None:
    np.testing.assert_allclose(np.diff(extent(made), axis=0)[0], size, atol=0.02)


def test_plants_are_as_large_as_asked_for_and_follow_their_seed() -> None:
    for plant in (lambda rng: tree(rng, 8.0, 2.0), lambda rng: bush(rng, 1.5, 1.0)):
        one, again, other = (plant(np.random.default_rng(seed)) for seed in (1, 1, 2))
        np.testing.assert_array_equal(one.vertices, again.vertices)
        assert not np.array_equal(one.vertices, other.vertices)
    spread = np.abs(tree(np.random.default_rng(0), 8.0, 2.0).vertices[:, :2])
    assert 1.5 < np.percentile(spread, 99) < 3.0
