"""Trajectories as TUM text: `stamp x y z qx qy qz qw` a line, `#` starts a comment.

Commas or semicolons may separate the numbers, commas may stand for decimal points, and a line of names may come first:
where it tells another order of the pose (`qw qx qy qz`), that order is read.
"""

from __future__ import annotations

import logging
import re
import warnings
from io import StringIO
from itertools import islice
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.errors import InputError, OutputError
from wiclosure.formats.plausible import plausible_path
from wiclosure.formats.pose_columns import POSE, line_of_names, pose_order
from wiclosure.formats.stamps import few_digits, nanoseconds, nanoseconds_of_column, seconds_text
from wiclosure.types import FloatArray, IntArray, Trajectory

logger = logging.getLogger(__name__)

COLUMNS = POSE
_ROW = np.dtype([("stamp", "S48"), ("pose", np.float64, (7,))])
_UNIT_TOLERANCE = 0.01  # quaternions printed with three decimals stay within this of length one
_LONGEST_QUATERNION = 1e6  # whoever normalises none writes none so long


def read_tum(path: Path | str, robot: str, drift: DriftModel | None = None) -> Trajectory:
    """The trajectory in a TUM file; stamps become exact integer nanoseconds, and of repeated ones the first counts.

    Args:
        path: text file, columns `stamp x y z qx qy qz qw` (seconds, metres).
        robot: name that the trajectory carries.
        drift: drift model that the trajectory carries.

    Raises:
        InputError: the file cannot be read, a line is malformed, not finite or goes back in time, or the stamps have
            lost their digits.
    """
    path = Path(path)
    text, order = _plain_text(path)
    rows = _load_rows(path, text)
    try:
        stamps_ns = nanoseconds_of_column(rows["stamp"])
    except ValueError:
        _explain(path, text)
    pose = rows["pose"][:, order]
    norm = np.linalg.norm(np.clip(pose[:, 3:], -_LONGEST_QUATERNION, _LONGEST_QUATERNION), axis=1)
    if (
        not np.isfinite(pose).all()
        or (norm >= _LONGEST_QUATERNION).any()
        or (norm < 1e-9).any()
        or (np.diff(stamps_ns) < 0).any()
    ):
        _explain(path, text)
    first = _first_of_each(path, rows["stamp"], stamps_ns)
    stamps_ns, pose, norm = stamps_ns[first], pose[first], norm[first]
    if (np.abs(norm - 1) > _UNIT_TOLERANCE).any():
        logger.warning("%s: quaternions are not of length one (worst %.3f); normalised", path, norm[_worst(norm)])
    near = plausible_path(path, stamps_ns, pose[:, :3])
    stamps_ns, pose = stamps_ns[near], pose[near]
    rotation = Rotation.from_quat(pose[:, 3:]).as_matrix()
    poses = se3.from_rotation_translation(rotation, pose[:, :3])
    return Trajectory(robot, stamps_ns, poses, drift or DriftModel())


def write_tum(path: Path | str, trajectory: Trajectory) -> None:
    """Writes a trajectory as TUM text: stamps exact to the nanosecond, numbers with all their digits.

    Raises:
        OutputError: the file cannot be written.
    """
    quat_xyzw = Rotation.from_matrix(trajectory.poses[:, :3, :3]).as_quat()
    numbers = np.column_stack([trajectory.positions, quat_xyzw]).tolist()
    stamps = seconds_text(trajectory.stamps_ns.tolist())
    lines = (f"{stamp} {' '.join(map(repr, row))}\n" for stamp, row in zip(stamps, numbers, strict=True))
    try:
        with Path(path).open("w", encoding="utf-8") as file:
            file.write(f"# {' '.join(COLUMNS)}\n")
            file.writelines(lines)
    except OSError as error:
        raise OutputError(f"cannot write the trajectory {path}: {error.strerror}; choose another place") from error


def _plain_text(path: Path) -> tuple[str, list[int]]:
    """The file's text with white space between the numbers, line for line, and where each number of the pose stands."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path} is not text; a trajectory is a TUM file: {' '.join(COLUMNS)} a line") from None
    except OSError as error:
        raise InputError(f"cannot read the trajectory {path}: {error.strerror}; check the path") from error
    names = line_of_names(text)
    order = [column - 1 for column in pose_order(path, names, COLUMNS)]
    if names and not names.lstrip().startswith("#"):
        text = text.replace(names, "#" + names, 1)
    first = next((line for line in text.splitlines() if line.partition("#")[0].strip()), "")
    if "," not in first and ";" not in first:
        return text, order
    decimal = ";" in first or (len(first.split()) == len(COLUMNS) and re.search(r"\d,\d", first) is not None)
    return text.replace(";", " ").replace(",", "." if decimal else " "), order


def _load_rows(path: Path, text: str) -> NDArray[np.void]:
    """All rows `(N,)`, stamps still as text."""
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="loadtxt: input contained no data")
            rows = np.loadtxt(StringIO(text), dtype=_ROW, comments="#", ndmin=1)
    except ValueError:
        _explain(path, text)
    if len(rows) == 0:
        raise InputError(f"{path} holds no poses; a trajectory is a TUM file: {' '.join(COLUMNS)} a line")
    return np.asarray(rows)


def _first_of_each(path: Path, texts: NDArray[np.bytes_], stamps_ns: IntArray) -> NDArray[np.bool_]:
    """Which rows `(N,)` are the first of their stamp.

    Raises:
        InputError: stamps repeat because they were written with too few digits.
    """
    first = np.concatenate([[True], np.diff(stamps_ns) > 0])
    if first.all():
        return first
    repeated = texts[int(np.argmin(first))].decode()
    if (digits := few_digits(repeated)) is not None:
        count = int(np.count_nonzero(stamps_ns == stamps_ns[int(np.argmin(first))]))
        raise InputError(
            f"{path}: the stamp {repeated} stands on {count} lines: whoever wrote it kept {digits} digits only;"
            " write stamps with nine decimals (NumPy: fmt='%.9f', C++: std::fixed << std::setprecision(9))"
        )
    logger.warning("%s: %d lines repeat a stamp; of each the first is used", path, int(np.count_nonzero(~first)))
    return first


def _explain(path: Path, text: str) -> NoReturn:
    """Finds the first bad line and says what is wrong with it; slow, only taken when something is."""
    previous_ns, previous_line = None, 0
    for line, content in enumerate(text.splitlines(), start=1):
        words = content.partition("#")[0].split()
        if not words:
            continue
        stamp_ns = _check_line(f"{path}, line {line}", words)
        if previous_ns is not None and stamp_ns < previous_ns:
            raise InputError(
                f"{path}, line {line}: stamp {words[0]} is before that of line {previous_line};"
                " sort the file by its first column"
            )
        previous_ns, previous_line = stamp_ns, line
    raise InputError(f"{path} is not a TUM trajectory: expected {' '.join(COLUMNS)} on each line")


def _check_line(place: str, words: list[str]) -> int:
    """The stamp of one line in nanoseconds."""
    if len(words) != len(COLUMNS):
        hint = " separated by spaces" if "," in "".join(words) else ""
        raise InputError(f"{place}: expected 8 numbers ({' '.join(COLUMNS)}){hint}, found {len(words)}")
    try:
        stamp_ns = nanoseconds(words[0])
    except ValueError as error:
        raise InputError(f"{place}: stamp {error}; expected seconds") from None
    numbers = np.array([_number(place, name, word) for name, word in islice(zip(COLUMNS, words, strict=True), 1, None)])
    if not np.abs(numbers[3:]).max() < _LONGEST_QUATERNION:
        raise InputError(f"{place}: the quaternion is {words[4:]}; expected qx qy qz qw of length one")
    if np.linalg.norm(numbers[3:]) < 1e-9:
        raise InputError(f"{place}: the quaternion is zero; expected qx qy qz qw of length one (no rotation: 0 0 0 1)")
    return stamp_ns


def _number(place: str, name: str, word: str) -> float:
    try:
        value = float(word)
    except ValueError:
        raise InputError(f"{place}: {name} is {word!r}; expected a number") from None
    if not np.isfinite(value):
        raise InputError(f"{place}: {name} is {word}; expected a finite number (drop the line if the pose is unknown)")
    return value


def _worst(norm: FloatArray) -> int:
    return int(np.argmax(np.abs(norm - 1)))
