"""One road that several robots share."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.types import Trajectory, WirelessLog, WirelessMeasurement


def straight(robot: str, size: int, y_m: float = 0.0, reverse: bool = False) -> Trajectory:
    x = 2.0 * np.arange(size)[:: -1 if reverse else 1]
    poses = se3.from_yaw(np.full(size, np.pi if reverse else 0.0), np.stack([x, np.full(size, y_m), 0 * x], axis=1))
    return Trajectory(robot, np.arange(size, dtype=np.int64) * 10**9, poses)


def ranges(world: dict[str, Trajectory]) -> WirelessLog:
    return WirelessLog(
        tuple(
            WirelessMeasurement(
                stamp_ns=int(stamp),
                receiver="beta",
                transmitter="alpha",
                range_m=float(
                    np.linalg.norm(world["alpha"].at(np.array([stamp])) - world["beta"].at(np.array([stamp])))
                ),
                range_sigma_m=0.5,
            )
            for stamp in world["beta"].stamps_ns[::4]
        )
    )


def winding_road(seed: int, size: int = 150, step_m: float = 2.0) -> np.ndarray:
    """Poses that begin at the identity and wind about in the plane."""
    rng = np.random.default_rng(seed)
    turn = np.repeat(rng.normal(0, 0.1, size // 10 + 1), 10)[: size - 1]
    poses = [np.eye(4)]
    for angle in turn:
        poses.append(poses[-1] @ se3.from_yaw(angle, np.array([step_m, 0.0, 0.0])))
    return np.array(poses)
