"""How large the surroundings are, as the sensor sees them: the one length from which others are derived."""

from __future__ import annotations

import numpy as np

from wiclosure.types import Float32Array, FloatArray

_ROOM_SHARE = 0.95
_VOXELS_PER_ROOM = 35.0
_COARSEST_M, _FINEST_M = 1.0, 0.125


def voxel_size_m(points: FloatArray | Float32Array) -> float:
    """Voxel size that suits the surroundings of one cloud `(N, 3)`, metres: 1, 0.5, 0.25 or 0.125.

    KISS-ICP takes a hundredth of the sensor's nominal range, 1 m for a 100 m sensor, wherever it stands.  That is too
    coarse indoors.  Here the distance within which 95 % of the points lie decides: about 35 m on a street (1 m
    voxels, as KISS-ICP has it), 20 m in a hall (0.5 m), 8 m in rooms (0.25 m).  Steps of two keep the answer the same
    from scan to scan and from robot to robot.
    """
    if len(points) == 0:
        return _COARSEST_M
    extent_m = float(np.quantile(np.linalg.norm(points, axis=1), _ROOM_SHARE))
    step = np.rint(np.log2(max(extent_m, 1e-3) / _VOXELS_PER_ROOM))
    return float(np.clip(2.0**step, _FINEST_M, _COARSEST_M))
