"""A place: its shapes, its ground, and the walls that mirror radio waves."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from wiclosure import se3
from wiclosure.simulation.world.ground import Ground
from wiclosure.simulation.world.mesh import Mesh, join
from wiclosure.types import Float32Array, FloatArray, IntArray

if TYPE_CHECKING:
    import open3d as o3d


@dataclass(frozen=True, slots=True, eq=False)
class Reflector:
    """A large upright plane face that mirrors radio waves.

    Args:
        start_m, end_m: `(2,)` its foot line, world x and y.
        low_m, high_m: its lower and upper edge, world z.
    """

    start_m: FloatArray
    end_m: FloatArray
    low_m: float
    high_m: float


class RayHits(NamedTuple):
    """What N rays hit first.

    Args:
        distance_m: `(N,)` along the rays, infinite where nothing was hit.
        cosine: `(N,)` of the angle between ray and surface normal.
    """

    distance_m: Float32Array
    cosine: Float32Array


@dataclass(frozen=True, eq=False)
class Scene:
    """A place with known geometry.

    Args:
        solid: what light and radio do not pass, besides the ground.
        ground: what robots drive on.
        slight: what light does not pass but radio bends around: trees, poles.
        reflectors: walls that mirror radio waves.
    """

    solid: Mesh
    ground: Ground
    slight: Mesh = field(default_factory=lambda: join([]))
    reflectors: tuple[Reflector, ...] = ()

    def __getstate__(self) -> dict[str, object]:
        """For other processes: without the ray casting tree, which each makes for itself."""
        return {name: value for name, value in vars(self).items() if name != "_raycaster"}

    @cached_property
    def _raycaster(self) -> o3d.t.geometry.RaycastingScene:
        # In this order: the ground has geometry id 0, then follows what stops radio too.
        return _raycaster(self.ground.mesh(), self.solid, self.slight)

    def cast(self, rays: Float32Array) -> RayHits:
        """First hits of `rays (N, 6)`: origin and unit direction."""
        return _cast(self._raycaster, rays)

    def obstacles(self, start_m: FloatArray, end_m: FloatArray) -> IntArray:
        """How many solid surfaces `(N,)` lie between the points `start_m (N, 3)` and `end_m (N, 3)`."""
        if len(start_m) == 0:
            return np.zeros(0, np.int64)
        import open3d as o3d

        # Unnormalised directions: a hit at t < 1 lies between the points. The ends themselves do not count.
        rays = np.concatenate([start_m, end_m - start_m], axis=1).astype(np.float32)
        crossings = self._raycaster.list_intersections(o3d.core.Tensor.from_numpy(rays))
        t = crossings["t_hit"].numpy()
        solid = 2 if len(self.solid.triangles) else 1
        between = (t > 1e-4) & (t < 1 - 1e-4) & (crossings["geometry_ids"].numpy() < solid)
        return np.bincount(crossings["ray_ids"].numpy()[between].astype(np.int64), minlength=len(rays))

    def clearance(self, points_m: FloatArray) -> FloatArray:
        """Distance `(N,)` from each point `(N, 3)` to the nearest surface, metres."""
        import open3d as o3d

        points = o3d.core.Tensor.from_numpy(points_m.astype(np.float32))
        return np.asarray(self._raycaster.compute_distance(points).numpy(), np.float64)


def cast_at(mesh: Mesh, rays: Float32Array) -> RayHits:
    """First hits of `rays (N, 6)` on a shape that stands there for a moment only."""
    if not len(mesh.triangles):
        return RayHits(np.full(len(rays), np.inf, np.float32), np.ones(len(rays), np.float32))
    return _cast(_raycaster(mesh), rays)


def _raycaster(*meshes: Mesh) -> o3d.t.geometry.RaycastingScene:
    import open3d as o3d  # takes over a second: only where rays are cast

    scene = o3d.t.geometry.RaycastingScene()
    for mesh in meshes:
        if len(mesh.triangles):
            scene.add_triangles(o3d.core.Tensor.from_numpy(mesh.vertices), o3d.core.Tensor.from_numpy(mesh.triangles))
    return scene


def _cast(raycaster: o3d.t.geometry.RaycastingScene, rays: Float32Array) -> RayHits:
    import open3d as o3d

    hits = raycaster.cast_rays(o3d.core.Tensor.from_numpy(rays))
    normal = hits["primitive_normals"].numpy()
    return RayHits(hits["t_hit"].numpy(), np.abs(np.einsum("ij,ij->i", normal, rays[:, 3:])))


LEAST_REFLECTOR_M = 2.0
"""Shorter faces scatter rather than mirror: they are few wavelengths of the first Fresnel zone."""


@dataclass(frozen=True, slots=True)
class Footprint:
    """The rectangle of a building, centred on its origin, length along x."""

    length_m: float
    width_m: float
    height_m: float

    def corners(self) -> FloatArray:
        """`(4, 3)` at z = 0, counter-clockwise."""
        half = np.array([self.length_m / 2, self.width_m / 2, 0.0])
        return np.asarray(np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * half)


class SceneBuilder:
    """Collects shapes on a ground; `build` makes the scene of them."""

    def __init__(self, ground: Ground) -> None:
        self.ground = ground
        self._solid: list[Mesh] = []
        self._slight: list[Mesh] = []
        self._reflectors: list[Reflector] = []

    def stand(self, mesh: Mesh, x_m: float, y_m: float, yaw_rad: float = 0.0) -> None:
        """Stands a solid shape on the ground."""
        self._solid.append(self._placed(mesh, x_m, y_m, yaw_rad))

    def plant(self, mesh: Mesh, x_m: float, y_m: float, yaw_rad: float = 0.0) -> None:
        """Stands a shape on the ground that radio bends around: a tree, a pole."""
        self._slight.append(self._placed(mesh, x_m, y_m, yaw_rad))

    def building(self, mesh: Mesh, footprint: Footprint, x_m: float, y_m: float, yaw_rad: float = 0.0) -> None:
        """Stands a solid shape on the ground whose upright faces over `footprint` mirror radio waves."""
        self.stand(mesh, x_m, y_m, yaw_rad)
        z_m = self._height(x_m, y_m)
        corners = se3.transform(se3.from_yaw(yaw_rad, np.array([x_m, y_m, 0.0])), footprint.corners())[:, :2]
        for start, end in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            if np.linalg.norm(end - start) >= LEAST_REFLECTOR_M:
                self._reflectors.append(Reflector(start, end, z_m, z_m + footprint.height_m))

    def hang(self, mesh: Mesh) -> None:
        """Adds a solid shape that is already in world coordinates."""
        self._solid.append(mesh)

    def build(self) -> Scene:
        """The scene of everything added."""
        return Scene(join(self._solid), self.ground, join(self._slight), tuple(self._reflectors))

    def _height(self, x_m: float, y_m: float) -> float:
        return float(self.ground.height(np.array([[x_m, y_m]]))[0])

    def _placed(self, mesh: Mesh, x_m: float, y_m: float, yaw_rad: float) -> Mesh:
        # A little sunk in: no gap under it on sloping ground.
        return mesh.at(x_m, y_m, self._height(x_m, y_m) - 0.05, yaw_rad)
