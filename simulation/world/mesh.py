"""Triangle meshes made of a few primitives: what the rays hit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wiclosure import se3
from wiclosure.types import Float32Array, FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles: `vertices (V, 3)` float32, metres, and `triangles (T, 3)` uint32 indices into them."""

    vertices: Float32Array
    triangles: NDArray[np.uint32]

    def moved(self, T_world_object: FloatArray) -> Mesh:
        """The same shape at another place; `T_world_object` is `(4, 4)`."""
        return Mesh(se3.transform(T_world_object, self.vertices.astype(float)).astype(np.float32), self.triangles)

    def at(self, x: float, y: float, z: float = 0.0, yaw_rad: float = 0.0) -> Mesh:
        """The same shape turned about z and moved to `(x, y, z)`."""
        return self.moved(se3.from_yaw(yaw_rad, np.array([x, y, z])))


_NOTHING = Mesh(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32))


def join(meshes: Iterable[Mesh]) -> Mesh:
    """One mesh of many."""
    parts = list(meshes)
    offsets = np.cumsum([0] + [len(part.vertices) for part in parts])
    return Mesh(
        np.concatenate([_NOTHING.vertices, *(part.vertices for part in parts)]),
        np.concatenate(
            [
                _NOTHING.triangles,
                *(part.triangles + np.uint32(offset) for part, offset in zip(parts, offsets[:-1], strict=True)),
            ]
        ),
    )


def _mesh(vertices: FloatArray, triangles: object) -> Mesh:
    return Mesh(np.asarray(vertices, np.float32), np.asarray(triangles, np.uint32).reshape(-1, 3))


def box(length_m: float, width_m: float, height_m: float) -> Mesh:
    """A box standing on z = 0, centred on the z axis; length along x, width along y."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [length_m / 2, width_m / 2]
    vertices = np.vstack([np.c_[corners, np.zeros(4)], np.c_[corners, np.full(4, height_m)]])
    sides = [[i, (i + 1) % 4, 4 + (i + 1) % 4, i, 4 + (i + 1) % 4, 4 + i] for i in range(4)]
    return _mesh(vertices, np.array([*sides, [4, 5, 6, 4, 6, 7]]))


def gable(length_m: float, width_m: float, height_m: float) -> Mesh:
    """A ridged roof over a `length x width` rectangle at z = 0, the ridge along x."""
    x, y = length_m / 2, width_m / 2
    vertices = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0], [-x, 0, height_m], [x, 0, height_m]])
    return _mesh(vertices, [[0, 1, 5], [0, 5, 4], [2, 3, 4], [2, 4, 5], [1, 2, 5], [3, 0, 4]])


def cylinder(radius_m: float, height_m: float, sides: int = 10) -> Mesh:
    """An upright cylinder (pole, trunk, round pillar) standing on z = 0, open below."""
    angle = 2 * np.pi * np.arange(sides) / sides
    ring = np.c_[radius_m * np.cos(angle), radius_m * np.sin(angle)]
    vertices = np.vstack([np.c_[ring, np.zeros(sides)], np.c_[ring, np.full(sides, height_m)], [[0, 0, height_m]]])
    i = np.arange(sides)
    j = (i + 1) % sides
    top = np.full(sides, 2 * sides)
    return _mesh(
        vertices,
        np.vstack([np.c_[i, j, j + sides], np.c_[i, j + sides, i + sides], np.c_[i + sides, j + sides, top]]),
    )


def tree(rng: np.random.Generator, height_m: float, crown_radius_m: float, leaves: int = 110) -> Mesh:
    """A trunk and a crown of loose leaf clusters, through which some rays pass."""
    trunk = cylinder(0.05 + 0.02 * height_m, 0.6 * height_m, sides=7)
    crown = _leaves(rng, np.array([crown_radius_m, crown_radius_m, 0.3 * height_m]), 0.68 * height_m, leaves)
    return join([trunk, crown])


def bush(rng: np.random.Generator, height_m: float, radius_m: float, leaves: int = 24) -> Mesh:
    """Leaf clusters from the ground up."""
    return _leaves(rng, np.array([radius_m, radius_m, 0.5 * height_m]), 0.5 * height_m, leaves)


def _leaves(rng: np.random.Generator, half_axes_m: FloatArray, centre_m: float, count: int) -> Mesh:
    """Triangles of any direction all over an ellipsoid whose centre is `centre_m` above the ground."""
    direction = rng.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    # The cube root fills the ellipsoid evenly; real crowns are denser outside.
    radius = rng.uniform(0.2, 1.0, size=(count, 1)) ** (1 / 3)
    centres = direction * radius * half_axes_m + [0, 0, centre_m]
    cluster = rng.normal(scale=0.22 * half_axes_m[0], size=(count, 3, 3)) + centres[:, None, :]
    return _mesh(cluster.reshape(-1, 3), np.arange(3 * count))


def car(length_m: float = 4.3, width_m: float = 1.75, height_m: float = 1.45) -> Mesh:
    """A parked car: a body, and a cabin on it."""
    body = box(length_m, width_m, 0.55 * height_m).at(0, 0, 0.15)
    cabin = box(0.5 * length_m, 0.88 * width_m, 0.45 * height_m).at(-0.25, 0, 0.15 + 0.55 * height_m)
    return join([body, cabin])


def pole(height_m: float = 6.0, radius_m: float = 0.09, arm_m: float = 0.0) -> Mesh:
    """A lamp post or sign, with an arm along x where `arm_m` > 0."""
    post = cylinder(radius_m, height_m, sides=8)
    if arm_m == 0:
        return post
    return join([post, box(arm_m, 0.12, 0.12).at(arm_m / 2, 0, height_m - 0.15)])
