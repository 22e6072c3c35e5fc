"""Trajectories as KITTI pose files: the twelve numbers of a 3x4 matrix a line, row by row, no stamps."""

from __future__ import annotations

from pathlib import Path

from wiclosure.errors import OutputError
from wiclosure.types import FloatArray


def write_kitti_poses(path: Path | str, poses: FloatArray) -> None:
    """Writes poses `(N, 4, 4)`, `T_world_body` or `T_world_lidar`, as they are (KITTI's own are the camera's).

    Twelve numbers a line with all digits.

    Raises:
        OutputError: the file cannot be written.
    """
    rows = poses[:, :3].reshape(-1, 12).tolist()
    try:
        Path(path).write_text("".join(" ".join(map(repr, row)) + "\n" for row in rows), encoding="ascii")
    except OSError as error:
        raise OutputError(f"cannot write the trajectory {path}: {error.strerror}; choose another place") from error
