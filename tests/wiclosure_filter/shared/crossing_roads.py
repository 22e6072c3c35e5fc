"""Two robots that hear each other on crossing winding roads."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.types import AoaPath, Trajectory, WirelessLog, WirelessMeasurement

STEPS = 80


def meeting(scale: float = 1.0) -> tuple[dict[str, Trajectory], WirelessLog, dict[str, np.ndarray]]:
    """Two robots on crossing winding roads, with exact measurements; odometry of b too long by `scale`."""
    s = 1.0 * np.arange(STEPS)
    truth = {
        "a": se3.from_yaw(0.3 * np.sin(s / 9), np.stack([s, 6 * np.sin(s / 12), 0 * s], axis=1)),
        "b": se3.from_yaw(2.0 + 0.4 * np.cos(s / 7), np.stack([60 - s, 12 + 8 * np.cos(s / 10), 0 * s], axis=1)),
    }
    stamps_ns = np.arange(STEPS, dtype=np.int64) * 10**9
    heard = []
    for k in range(0, STEPS, 4):
        seen = se3.between(truth["a"][k], truth["b"][k])[:3, 3]
        path = AoaPath(float(np.arctan2(seen[1], seen[0])), 0.1)
        heard.append(WirelessMeasurement(k * 10**9, "a", "b", float(np.linalg.norm(seen)), 0.3, (path,)))
    b = se3.inverse(truth["b"][0]) @ truth["b"]
    b[:, :3, 3] *= scale
    team = {"a": Trajectory("a", stamps_ns, truth["a"]), "b": Trajectory("b", stamps_ns, b)}
    return team, WirelessLog(tuple(heard)), truth
