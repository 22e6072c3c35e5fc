"""Points on the walls of one room."""

from __future__ import annotations

import numpy as np


def room(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-1, 1, (3000, 3)) * [10, 8, 3]
    wall = rng.integers(0, 3, len(points))
    points[np.arange(len(points)), wall] = np.sign(points[np.arange(len(points)), wall]) * np.array([10, 8, 3])[wall]
    return points
