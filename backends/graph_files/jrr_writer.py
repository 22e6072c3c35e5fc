"""The estimate as JSON Robot Results (JRR), which the tools of JSON Robot Logs compare with the truth."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.backends.graph_files.naming import SYMBOL_SHIFT
from wiclosure.errors import OutputError
from wiclosure.types import FloatArray

METHOD = "wiclosure"


def write_robot_results(
    path: Path,
    title: str,
    poses: Mapping[str, FloatArray],
    keys: Mapping[str, NDArray[np.uint64]],
    rejected: Sequence[tuple[str, int, int]],
    *,
    planar: bool = False,
) -> None:
    """Writes the poses of all robots, and which measurements were taken for outliers.

    Args:
        path: the file.
        title: name of the data set in its robot log.
        poses: `T_world_body (N, 4, 4)` by robot.
        keys: `(N,)` GTSAM's symbols of the same; their characters are the robots of the file.
        rejected: robot, entry and measurement in the robot log of each rejected loop.
        planar: whether the log's poses are planar.

    Raises:
        OutputError: the file cannot be written.
    """
    solutions: dict[str, list[dict[str, Any]]] = {}
    for robot, of_robot in poses.items():
        for key, value in zip(keys[robot].tolist(), _values(of_robot, planar=planar), strict=True):
            solutions.setdefault(chr(key >> SYMBOL_SHIFT), []).append(value | {"key": key})
    outliers: dict[str, list[list[int]]] = {robot: [] for robot in solutions}
    for robot, entry, measurement in sorted(rejected):
        outliers.setdefault(robot, []).append([entry, measurement])
    content = {
        "dataset_name": title,
        "method_name": METHOD,
        "robots": [ord(robot) for robot in solutions],
        "solutions": solutions,
        "outliers": outliers,
    }
    try:
        path.write_text(json.dumps(content, allow_nan=False) + "\n", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder with --out") from error


def _values(T: FloatArray, *, planar: bool) -> list[dict[str, Any]]:
    if planar:
        rows = np.column_stack([T[:, :2, 3], se3.yaw(T)]).tolist()
        return [{"type": "Pose2", "x": x, "y": y, "theta": theta} for x, y, theta in rows]
    quat_wxyz = Rotation.from_matrix(T[:, :3, :3]).as_quat(scalar_first=True).tolist()
    return [
        {"type": "Pose3", "translation": t, "rotation": q} for t, q in zip(T[:, :3, 3].tolist(), quat_wxyz, strict=True)
    ]
