"""Trajectories as KITTI pose files: the twelve numbers of a 3x4 matrix a line, row by row, as a rule without stamps."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure.errors import InputError, OutputError
from wiclosure.formats.plausible import FURTHEST_M
from wiclosure.formats.radio.radio_units import stamp_ns
from wiclosure.formats.text_table import encoding_of
from wiclosure.types import FloatArray, IntArray

_SKEWNESS = 0.01  # rotations printed with three digits stay within this of orthonormal; they are made exact
_MOST_FRAMES = 1e9
_NUMBERS = (12, 13, 16, 17)  # a line: three or four rows, and a frame's number (KITTI-360) or a stamp before them


class KittiPoses(NamedTuple):
    """Poses `(N, 4, 4)`, and the numbers `(N,)` of their frames, or their stamps `(N,)`, where the file states them."""

    poses: FloatArray
    frames: IntArray | None
    stamps_ns: IntArray | None


def read_kitti_poses(path: Path | str) -> KittiPoses:
    """The poses in a KITTI pose file, as they stand there.

    Args:
        path: 12 numbers a line (the upper three rows of a pose) or 16, perhaps after the frame's number or a stamp.

    Raises:
        InputError: the file cannot be read, or a line is something else.
    """
    path = Path(path)
    try:
        lines = [line.partition("#")[0].split() for line in path.read_text(encoding=encoding_of(path)).splitlines()]
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the poses {path}: {error}; check the file") from error
    rows = [(number, words) for number, words in enumerate(lines, start=1) if words]
    width = len(rows[0][1]) if rows else 12
    numbers = np.zeros((len(rows), width))
    for row, (number, words) in enumerate(rows):
        try:
            numbers[row] = np.array(words, float)
        except ValueError:
            width = 0
        if width not in _NUMBERS:
            raise InputError(f"{path}, line {number}: expected 12 numbers (a 3 x 4 matrix), row by row")
        if not np.isfinite(numbers[row]).all():
            raise InputError(f"{path}, line {number}: not finite; expected 12 numbers (a 3 x 4 matrix)")
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3] = numbers[:, width % 4 :][:, :12].reshape(-1, 3, 4)
    if len(far := np.flatnonzero((np.abs(poses[:, :3, 3]) > FURTHEST_M).any(axis=1))):
        raise InputError(f"{path}, line {rows[far[0]][0]}: a position beyond {FURTHEST_M:g} m; expected metres")
    first = [(number, words[0]) for number, words in rows] if width % 4 else []
    frames, stamps_ns = _frames_or_stamps(path, first) if first else (None, None)
    return KittiPoses(_made_exact(path, poses, [number for number, _ in rows]), frames, stamps_ns)


def _frames_or_stamps(path: Path, column: list[tuple[int, str]]) -> tuple[IntArray | None, IntArray | None]:
    """What the first numbers of the lines are: whole numbers of frames, or times that increase."""
    numbers = np.array([float(word) for _, word in column])
    if (numbers == np.round(numbers)).all() and (np.abs(numbers) < _MOST_FRAMES).all():
        return numbers.astype(np.int64), None
    stamps_ns = np.zeros(len(column), np.int64)
    for row, (line, word) in enumerate(column):
        try:
            stamps_ns[row] = stamp_ns(word, "auto")
        except ValueError:
            raise InputError(f"{path}, line {line}: {word[:40]} is neither a frame's number nor a time") from None
    if len(back := np.flatnonzero(np.diff(stamps_ns) <= 0)):
        line, word = column[back[0] + 1]
        raise InputError(
            f"{path}, line {line}: {word[:40]} is no frame's number, and as a time it is not after that of the line"
            " before"
        )
    return None, stamps_ns


def _made_exact(path: Path, poses: FloatArray, lines: list[int]) -> FloatArray:
    """Poses whose rotations are orthonormal."""
    R = poses[:, :3, :3]
    if (np.abs(R) > 2).any():
        R = np.clip(R, -2, 2)  # no rotation either, and its square is a number
    skewness = np.abs(R @ np.swapaxes(R, 1, 2) - np.eye(3)).max(axis=(1, 2)) + (np.linalg.det(R) < 0)
    if (skewness > _SKEWNESS).any():
        raise InputError(
            f"{path}, line {lines[int(np.argmax(skewness))]}: not a pose; expected a 3 x 4 matrix [R | t], row by row"
        )
    if len(poses):
        poses[:, :3, :3] = Rotation.from_matrix(R).as_matrix()
    return poses


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
