"""Paths, and errors of known size."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.types import Trajectory

SECOND = 1_000_000_000


def path(seed, n=80, robot="alpha"):
    """A winding path on uneven ground, a pose a second."""
    rng = np.random.default_rng(seed)
    step = np.zeros((n - 1, 6))
    step[:, 2], step[:, 1], step[:, 3] = (
        rng.normal(0, 0.15, n - 1),
        rng.normal(0, 0.02, n - 1),
        rng.uniform(0.5, 1.5, n - 1),
    )
    poses = [se3.from_yaw(rng.uniform(-3, 3), rng.normal(0, 30, 3))]
    for T in se3.exp(step):
        poses.append(poses[-1] @ T)
    return Trajectory(robot, np.arange(n, dtype=np.int64) * SECOND, np.stack(poses))


def disturbed(trajectory, seed, sigma=0.05):
    noise = np.random.default_rng(seed).normal(0, sigma, (len(trajectory), 6)) * np.repeat([0.1, 1.0], 3)
    return Trajectory(trajectory.robot, trajectory.stamps_ns, trajectory.poses @ se3.exp(noise))


def turned(seed):
    rng = np.random.default_rng(seed)
    return se3.from_rotation_translation(Rotation.random(rng=rng).as_matrix(), rng.normal(0, 100, 3))
