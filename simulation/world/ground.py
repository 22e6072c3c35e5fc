"""Ground that is not quite flat."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import RectBivariateSpline

from wiclosure.simulation.world.mesh import Mesh
from wiclosure.types import FloatArray


@dataclass(frozen=True, eq=False)
class Ground:
    """Heights on a regular grid, smooth between the grid points.

    Args:
        x_m: `(X,)` increasing, evenly spaced, X >= 4.
        y_m: `(Y,)` likewise.
        height_m: `(X, Y)`.
    """

    x_m: FloatArray
    y_m: FloatArray
    height_m: FloatArray

    @cached_property
    def _surface(self) -> RectBivariateSpline:
        return RectBivariateSpline(self.x_m, self.y_m, self.height_m, kx=3, ky=3, s=0)

    @cached_property
    def _slopes(self) -> tuple[Callable[..., FloatArray], Callable[..., FloatArray]]:
        """Along x and y, prepared once: asked of the surface itself, every call would go over the whole grid."""
        return self._surface.partial_derivative(1, 0), self._surface.partial_derivative(0, 1)

    def height(self, xy: FloatArray) -> FloatArray:
        """Heights `(N,)` at `xy (N, 2)`; outside of the grid those of its border."""
        return np.asarray(self._surface.ev(xy[:, 0], xy[:, 1]), float)

    def normal(self, xy: FloatArray) -> FloatArray:
        """Unit normals `(N, 3)`, pointing up."""
        slope_x, slope_y = (slope(xy[:, 0], xy[:, 1], grid=False) for slope in self._slopes)
        normal = np.stack([-slope_x, -slope_y, np.ones(len(xy))], axis=1)
        return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))

    def mesh(self) -> Mesh:
        """Two triangles a grid cell."""
        x, y = np.meshgrid(self.x_m, self.y_m, indexing="ij")
        corner = np.arange(x.size).reshape(x.shape)
        a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
        return Mesh(
            np.stack([x.ravel(), y.ravel(), self.height_m.ravel()], axis=1).astype(np.float32),
            np.vstack([np.c_[a, b, c], np.c_[a, c, d]]).astype(np.uint32),
        )


def rough_ground(
    rng: np.random.Generator,
    low_m: tuple[float, float],
    high_m: tuple[float, float],
    roughness_m: float,
    cell_m: float = 1.0,
    wavelengths_m: tuple[float, float] = (5.0, 60.0),
) -> Ground:
    """Ground made of waves of random direction.

    Args:
        rng: chooses directions and phases.
        low_m: lower corner (x, y) of the rectangle that it covers.
        high_m: upper corner.
        roughness_m: standard deviation of the height; 0 gives a plane. Long waves carry most of it, as on real ground,
            where height grows with wavelength.
        cell_m: grid spacing; below half of the shortest wavelength.
        wavelengths_m: shortest and longest wave.
    """
    x_m = np.linspace(low_m[0], high_m[0], max(4, round((high_m[0] - low_m[0]) / cell_m) + 1))
    y_m = np.linspace(low_m[1], high_m[1], max(4, round((high_m[1] - low_m[1]) / cell_m) + 1))
    waves = 24
    wavelength = np.geomspace(*wavelengths_m, waves)
    direction = rng.uniform(0, 2 * np.pi, waves)
    phase = rng.uniform(0, 2 * np.pi, waves)
    k = 2 * np.pi / wavelength
    amplitude = wavelength / np.sqrt(np.sum(wavelength**2) / 2) * roughness_m
    along = np.cos(direction)[:, None, None] * x_m[None, :, None] + np.sin(direction)[:, None, None] * y_m[None, None]
    height = np.einsum("w,wxy->xy", amplitude, np.sin(k[:, None, None] * along + phase[:, None, None]))
    return Ground(x_m, y_m, height)
