"""Level alignments under which two maps look alike: the floor plan of one laid over that of the other, every way round.

Where surroundings repeat themselves or are symmetric, several fit.  All headings and shifts are tried at once, as the
correlation of two occupancy images through their Fourier transforms (Lewis, "Fast normalized cross-correlation", 1995,
without the normalisation: what counts is the share of one map that finds something in the other).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import small_gicp
from numpy.typing import NDArray
from scipy import fft
from scipy.ndimage import gaussian_filter, maximum_filter

from wiclosure import se3
from wiclosure.frontends.registration.initial_guesses import REACH_VOXELS, REACH_YAW_RAD
from wiclosure.frontends.registration.prepared_cloud import LEVEL_GROUND, NEIGHBOURS
from wiclosure.types import Float32Array, FloatArray

_MOST_CELLS = 256  # across both maps: of larger ones cells are larger
_CELL_VOXELS = 2.0
_TOLERANCE_CELLS = 3
_FINEST_TURN_RAD, _COARSEST_TURN_RAD = 0.035, 0.1
_PEAKS_PER_TURN = 4
_LEAST_SHARE = 0.9  # of what both maps share as they lie
_MOST_WAYS = 6


@dataclass(frozen=True, slots=True, eq=False)
class LookAlike:
    """A level transform that lays one map over the other.

    Args:
        T: `(4, 4)`, of the moved map.
        share: of its occupied cells that lie on or beside occupied ones of the other.
    """

    T: FloatArray
    share: float


def standing_points(clouds: Sequence[Float32Array], poses: FloatArray, voxel_m: float) -> FloatArray:
    """What stands on the ground in clouds `(N_k, 3)` of keyframes at `poses (K, 4, 4)`: points `(M, 3)`."""
    found = [np.zeros((0, 3))]
    for cloud, pose in zip(clouds, poses, strict=True):
        points, _ = small_gicp.preprocess_points(np.asarray(cloud, np.float64), voxel_m, num_neighbors=NEIGHBOURS)
        upright = np.abs(np.asarray(points.normals())[:, 2]) < LEVEL_GROUND
        found.append(se3.transform(pose, np.asarray(points.points())[upright, :3]))
    return np.concatenate(found)


def other_ways(fixed: FloatArray, moved: FloatArray, voxel_m: float) -> list[LookAlike]:
    """Ways to lay a map that fits over the other one, and that share about as much; the best first.

    One of each neighbourhood within which registration finds the same pose, that of the maps as they lie left out.

    Args:
        fixed: points `(N, 3)`.
        moved: points `(M, 3)`, in the same frame, where they fit.
        voxel_m: resolution of both.
    """
    ways = all_ways(fixed, moved, voxel_m)
    if not ways:
        return []
    middle, reach_m = moved.mean(axis=0), REACH_VOXELS * voxel_m

    def same(one: FloatArray, other: FloatArray) -> bool:
        apart = np.linalg.norm(se3.transform(one, middle) - se3.transform(other, middle))
        return bool(apart < reach_m and abs(se3.yaw(se3.between(one, other))) < REACH_YAW_RAD)

    as_they_lie = max((way.share for way in ways if same(way.T, np.eye(4))), default=0.0)
    chosen = [LookAlike(np.eye(4), as_they_lie)]
    for way in ways:
        if way.share < _LEAST_SHARE * as_they_lie or len(chosen) > _MOST_WAYS:
            break
        if not any(same(way.T, other.T) for other in chosen):
            chosen.append(way)
    return chosen[1:]


def all_ways(fixed: FloatArray, moved: FloatArray, voxel_m: float) -> list[LookAlike]:
    """The best shifts of one map over the other at each heading, the best first."""
    if len(fixed) == 0 or len(moved) == 0:
        return []
    raster = _Raster.of(fixed, moved, voxel_m)
    half_cells = np.unique(np.rint(moved[:, :2] / (raster.cell_m / 2)), axis=0)
    points = half_cells * (raster.cell_m / 2) - raster.middle_moved
    found: list[LookAlike] = []
    for yaw_rad in np.linspace(0.0, 2 * np.pi, raster.turns, endpoint=False).tolist():
        found += raster.laid_over(points, yaw_rad)
    return sorted(found, key=lambda one: -one.share)


@dataclass(frozen=True, slots=True, eq=False)
class _Raster:
    """Both maps as images, each about its own middle.

    Args:
        cell_m: size of a cell.
        cells: across an image, room for all shifts included.
        turns: headings that are tried.
        middle_fixed, middle_moved: `(2,)`.
        spectrum: of the fixed map, its cells grown by their neighbours.
    """

    cell_m: float
    cells: int
    turns: int
    middle_fixed: FloatArray
    middle_moved: FloatArray
    spectrum: NDArray[np.complex64]

    @classmethod
    def of(cls, fixed: FloatArray, moved: FloatArray, voxel_m: float) -> _Raster:
        (middle_fixed, radius_fixed_m), (middle_moved, radius_moved_m) = _circle(fixed), _circle(moved)
        across_m = 2 * (radius_fixed_m + radius_moved_m)
        cell_m = max(_CELL_VOXELS * voxel_m, across_m / _MOST_CELLS)
        cells = fft.next_fast_len(int(across_m / cell_m) + 2 * _TOLERANCE_CELLS, real=True)
        turn_rad = float(np.clip(2 * cell_m / max(radius_moved_m, cell_m), _FINEST_TURN_RAD, _COARSEST_TURN_RAD))
        turns = int(np.ceil(2 * np.pi / turn_rad))
        image = maximum_filter(_image(fixed[:, :2] - middle_fixed, cells, cell_m), _TOLERANCE_CELLS, mode="wrap")
        return cls(cell_m, cells, turns, middle_fixed, middle_moved, fft.rfft2(image))

    def laid_over(self, moved: FloatArray, yaw_rad: float) -> list[LookAlike]:
        """The best shifts of points `(M, 2)` about their middle, at one heading."""
        turned = se3.from_yaw(yaw_rad, np.zeros(3))
        image = _image(moved @ turned[:2, :2].T, self.cells, self.cell_m)
        found = fft.irfft2(self.spectrum * np.conj(fft.rfft2(image)), (self.cells, self.cells))
        found = np.rint(found).astype(np.float64)  # counts of cells
        # Grown cells make plateaus of equal counts: of these the middle is the peak, or one would pass for several.
        width = 2 * _TOLERANCE_CELLS + 1
        ranked = found + gaussian_filter(found, _TOLERANCE_CELLS / 2, mode="wrap") / (2 * image.sum())
        tops = np.flatnonzero((ranked == maximum_filter(ranked, width, mode="wrap")).ravel())
        best = tops[np.argsort(ranked.ravel()[tops])[::-1][:_PEAKS_PER_TURN]]
        steps = np.stack(np.unravel_index(best, found.shape), axis=-1)
        steps = np.where(steps > self.cells // 2, steps - self.cells, steps)
        at = self.middle_fixed + steps * self.cell_m - turned[:2, :2] @ self.middle_moved
        transforms = se3.from_yaw(np.full(len(at), yaw_rad), np.column_stack([at, np.zeros(len(at))]))
        shares = found.ravel()[best] / image.sum()
        return [LookAlike(T, float(share)) for T, share in zip(transforms, shares, strict=True)]


def _circle(points: FloatArray) -> tuple[FloatArray, float]:
    """A middle `(2,)` of points `(N, 3)` from above, and how far the farthest is from it."""
    flat = points[:, :2]
    middle = (flat.min(axis=0) + flat.max(axis=0)) / 2
    return middle, float(np.linalg.norm(flat - middle, axis=1).max())


def _image(points: FloatArray, cells: int, cell_m: float) -> NDArray[np.float32]:
    """Occupied cells of points `(N, 2)`; the origin is a corner, and what lies before it comes from the far end."""
    image = np.zeros((cells, cells), np.float32)
    rows, columns = np.rint(points / cell_m).astype(np.int64).T
    image[rows, columns] = 1.0
    return image
