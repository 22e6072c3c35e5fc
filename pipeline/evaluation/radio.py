"""What the radio was worth, and where the robots start relative to each other: both need no ground truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.pipeline.evaluation.metrics import RadioMetrics, StartMetrics
from wiclosure.types import FilterResult, FrameAlignment, Trajectory


def radio_metrics(filtered: FilterResult) -> dict[str, RadioMetrics]:
    """The alignment of each pair of robots of which the radio tells anything, by `a-b`."""
    links = {(found.robot_a, found.robot_b): len(found) for found in filtered.links}
    return {
        f"{found.robot_a}-{found.robot_b}": _alignment(found, links.get((found.robot_a, found.robot_b)))
        for found in filtered.alignments
    }


def _alignment(found: FrameAlignment, links: int | None) -> RadioMetrics:
    """Standard deviations of `T_a_b`: yaw, and along the horizontal axis on which its place is known worst."""
    yaw_deg = horizontal_m = height_m = None
    if found.covariance is not None:
        yaw_deg = float(np.degrees(np.sqrt(found.covariance[2, 2])))
        horizontal_m = float(np.sqrt(np.linalg.eigvalsh(found.covariance[3:5, 3:5])[-1]))
        height_m = float(np.sqrt(found.covariance[5, 5]))
    explained = None if found.best is None else len({m for m, _ in found.best.paths_kept})
    return {
        "certain": not found.ambiguous,
        "reason": found.reason,
        "yaw_sigma_deg": yaw_deg,
        "horizontal_sigma_m": horizontal_m,
        "height_sigma_m": height_m,
        "measurements_explained": explained,
        "links_used": links,
    }


def start_metrics(merged: Mapping[str, Trajectory], components: Sequence[Sequence[str]]) -> dict[str, StartMetrics]:
    """The first pose of b in that of a, for each two robots that accepted closures connect, by `a-b`."""
    starts: dict[str, StartMetrics] = {}
    for component in components:
        for a, b in combinations((robot for robot in merged if robot in component), 2):
            T_a_b = se3.between(merged[a].poses[:1], merged[b].poses[:1])[0]
            yaw, pitch, roll = Rotation.from_matrix(T_a_b[:3, :3]).as_euler("ZYX", degrees=True)
            x, y, z = map(float, T_a_b[:3, 3])
            yaw, pitch, roll = map(float, (yaw, pitch, roll))
            starts[f"{a}-{b}"] = StartMetrics(x_m=x, y_m=y, z_m=z, yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll)
    return starts
