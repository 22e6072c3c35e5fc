"""A calibration error that all beams of a LiDAR share."""

from __future__ import annotations

import numpy as np

from wiclosure.types import FloatArray


def elevation_corrected(points: FloatArray, angle_deg: float) -> FloatArray:
    """Points `(N, 3)` with every beam turned up by `angle_deg`; ranges and azimuths stay.

    With 0.205 degrees this is what KISS-ICP's readers do to every scan of KITTI.
    """
    angle = np.deg2rad(angle_deg)
    level_m, height_m = np.hypot(points[:, 0], points[:, 1]), points[:, 2]
    stretch = np.cos(angle) - np.sin(angle) * height_m / np.maximum(level_m, 1e-9)
    return np.column_stack(
        [points[:, 0] * stretch, points[:, 1] * stretch, np.cos(angle) * height_m + np.sin(angle) * level_m]
    )
