"""Points of what moves: other scans of the same robot, a little earlier and later, looked through where they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from wiclosure import se3
from wiclosure.frontends.registration.free_space import FreeSpace
from wiclosure.types import BoolArray, Float32Array, FloatArray

NEIGHBOURS = (-20, -10, -5, 5, 10, 20)  # keyframes: walkers have left their place, near enough to see it still
FEWEST = 2  # of the neighbours that must have looked through: one alone may be off by its own pose


def standing(clouds: Sequence[Float32Array], T_world_body: FloatArray, voxel_m: float) -> Iterator[BoolArray]:
    """Which points of every keyframe's cloud belong to what does not move.

    Args:
        clouds: K clouds `(N_k, 3)` of one robot's keyframes, each of a single scan, in the body's axes.
        T_world_body: `(K, 4, 4)`.
        voxel_m: how finely the clouds are thinned.
    """
    spaces: dict[int, FreeSpace] = {}
    reach = max(NEIGHBOURS)
    for k, cloud in enumerate(clouds):
        spaces.pop(k - reach - 1, None)
        near = [k + offset for offset in NEIGHBOURS if 0 <= k + offset < len(clouds)]
        for n in near:
            if n not in spaces:
                spaces[n] = FreeSpace.of(np.asarray(clouds[n], float), voxel_m)
        yield ~_moving(cloud, T_world_body[k], [(spaces[n], T_world_body[n]) for n in near])


def _moving(cloud: Float32Array, T_world_here: FloatArray, near: Sequence[tuple[FreeSpace, FloatArray]]) -> BoolArray:
    """Which points of a cloud enough of the others looked through."""
    looked_through = np.zeros(len(cloud), int)
    for space, T_world_there in near:
        T_there_here = se3.between(T_world_there, T_world_here)
        looked_through += space.conflicts(se3.transform(T_there_here, np.asarray(cloud, float)))
    return np.asarray(looked_through >= FEWEST)
