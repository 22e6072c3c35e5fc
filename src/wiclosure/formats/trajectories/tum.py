"""Trajectories as TUM text: `stamp x y z qx qy qz qw` a line, `#` starts a comment.

Commas or semicolons may separate the numbers, commas may stand for decimal points, and a line of names may come first:
where it tells another order of the pose (`qw qx qy qz`), that order is read.
"""

from __future__ import annotations

import logging
import re
import warnings
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.errors import InputError, OutputError
from wiclosure.formats.plausible import LONGEST_QUATERNION, plausible_path
from wiclosure.formats.radio.radio_units import TimeUnit, stamp_ns, stamp_unit_of_path
from wiclosure.formats.stamps import few_digits, nanoseconds, nanoseconds_of_column, seconds_text
from wiclosure.formats.text_cells import is_number
from wiclosure.formats.text_table import encoding_of
from wiclosure.formats.trajectories.pose_columns import POSE, line_of_names, pose_columns, stated_unit
from wiclosure.types import FloatArray, IntArray, Trajectory

logger = logging.getLogger(__name__)

COLUMNS = POSE
_ROW = np.dtype([("stamp", "S48"), ("pose", np.float64, (7,))])
_NO_QUATERNION = 0.5  # of length
_EMPTY_CELL = re.compile(r"(^|,)(?=,)", re.MULTILINE)
_SAMPLE = 100
_UNIT_TOLERANCE = 0.01  # quaternions printed with three decimals stay within this of length one


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
    text, columns, names = _plain_text(path)
    rows = _load_rows(path, text, columns)
    try:
        stamps_ns = _stamps_ns(path, rows["stamp"], names)
    except (ValueError, ArithmeticError):
        _explain(path, text, columns)
    pose = rows["pose"]
    norm = np.linalg.norm(np.clip(pose[:, 3:], -LONGEST_QUATERNION, LONGEST_QUATERNION), axis=1)
    proper = np.isfinite(pose).all() and (norm >= 1e-9).all() and (norm < LONGEST_QUATERNION).all()
    if not proper or (np.diff(stamps_ns) < 0).any():
        _explain(path, text, columns)
    first = _first_of_each(path, rows["stamp"], stamps_ns)
    stamps_ns, pose, norm = stamps_ns[first], pose[first], norm[first]
    if np.median(np.abs(norm - 1)) > _NO_QUATERNION:
        raise InputError(
            f"{path}: what should be quaternions is not of length one (typically {np.median(norm):.3g}): it holds no"
            f" poses, or in another order than {' '.join(COLUMNS)}; name its columns in a first line"
        )
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


def _plain_text(path: Path) -> tuple[str, list[int], str]:
    """The text with white space between the numbers, line for line; where its columns stand; the line of names."""
    try:
        text = path.read_text(encoding=encoding_of(path))
    except (UnicodeDecodeError, InputError):
        raise InputError(f"{path} is not text; a trajectory is a TUM file: {' '.join(COLUMNS)} a line") from None
    except OSError as error:
        raise InputError(f"cannot read the trajectory {path}: {error.strerror}; check the path") from error
    names = line_of_names(text)
    columns = pose_columns(path, names, COLUMNS)
    text, first = _without_head(text, names)
    if "," not in first and ";" not in first:
        return text, columns, names
    decimal = ";" in first or (len(first.split()) == len(COLUMNS) and re.search(r"\d,\d", first) is not None)
    if decimal:
        return re.sub(r"[;\t]", " ", text).replace(",", "."), columns, names
    return _EMPTY_CELL.sub(r"\1- ", text.replace(" ", "")).replace(",", " "), columns, names


def _without_head(text: str, names: str) -> tuple[str, str]:
    """The text with all lines above the first row as comments, and that row."""
    head, line, rest = text.partition(names) if names else ("", "", text)
    above = (head + line).split("\n") if names else []
    rows = rest.split("\n")
    begun = 0 if names else next((n for n, row in enumerate(rows) if _begins(row)), 0)
    first = next((row for row in rows[begun:] if row.partition("#")[0].strip()), "")
    if not names and not begun:
        return text, first
    lines = [*above, *rows] if not names else [*above[:-1], above[-1] + rows[0], *rows[1:]]
    count = len(above) if names else begun
    return "\n".join(["#" + row if n < count else row for n, row in enumerate(lines)]), first


def _begins(row: str) -> bool:
    """Whether a line is the first of the poses, or a comment that needs no mark."""
    words = re.split(r"[\s,;]+", row.partition("#")[0].strip())
    return len(words) > 1 and is_number(words[0]) and is_number(words[1])


def _load_rows(path: Path, text: str, columns: Sequence[int]) -> NDArray[np.void]:
    """All rows `(N,)`, stamps still as text; of rows with eight numbers each must have eight."""
    width = next((len(row.partition("#")[0].split()) for row in text.splitlines() if row.partition("#")[0].strip()), 0)
    chosen = None if width == len(COLUMNS) and list(columns) == list(range(width)) else columns
    try:
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="loadtxt: input contained no data")
            rows = np.loadtxt(StringIO(text), dtype=_ROW, comments="#", ndmin=1, usecols=chosen)
    except ValueError:
        _explain(path, text, columns)
    if len(rows) == 0:
        raise InputError(f"{path} holds no poses; a trajectory is a TUM file: {' '.join(COLUMNS)} a line")
    return np.asarray(rows)


def _stamps_ns(path: Path, stamps: NDArray[np.bytes_], names: str) -> IntArray:
    """Nanoseconds `(N,)` of stamps in the unit that the line of names states, else by their size and steps."""
    if not len(stamps):
        return np.zeros(0, np.int64)
    by_size = _unit_by_size(stamps)
    stated = None if by_size == "auto" else stated_unit(names)
    if (unit := stated or by_size) == "s":
        return nanoseconds_of_column(stamps)
    if unit == "ns" and not names:
        raise InputError(
            f"{path}: its stamps are nanoseconds, as EuRoC's, whose quaternions begin with w; name its columns in a"
            f" first line ({' '.join(COLUMNS)}), or write seconds"
        )
    if stated is None:
        read_as = "dates" if unit == "auto" else unit
        logger.warning("%s: its stamps are read as %s; those of TUM files are seconds", path, read_as)
    return np.array([stamp_ns(stamp.decode(), unit) for stamp in stamps], np.int64)


def _unit_by_size(stamps: NDArray[np.bytes_]) -> TimeUnit:
    """Of stamps that are numbers; `auto` where they are dates."""
    sample = [stamp.decode() for stamp in stamps[:_SAMPLE].tolist()]
    return stamp_unit_of_path(sample) if is_number(sample[0]) else "auto"


def _first_of_each(path: Path, texts: NDArray[np.bytes_], stamps_ns: IntArray) -> NDArray[np.bool_]:
    """Which rows `(N,)` are the first of their stamp.

    Raises:
        InputError: stamps repeat because they were written with too few digits.
    """
    first = np.concatenate([[True], np.diff(stamps_ns) > 0])
    if first.all():
        return first
    repeated = texts[int(np.argmin(first))].decode()
    coarse = sum(few_digits(text.decode()) is not None for text in texts[~first][:_SAMPLE].tolist())
    digits = few_digits(repeated)
    again = int(np.count_nonzero(~first))
    if digits is not None and 2 * coarse > min(_SAMPLE, again):  # not whole seconds by chance
        count = int(np.count_nonzero(stamps_ns == stamps_ns[int(np.argmin(first))]))
        raise InputError(
            f"{path}: the stamp {repeated} stands on {count} lines: whoever wrote it kept {digits} digits only;"
            " write stamps with nine decimals (NumPy: fmt='%.9f', C++: std::fixed << std::setprecision(9))"
        )
    if 2 * again > len(first) and not any(b"." in text for text in texts.tolist()):
        raise InputError(
            f"{path}: whole seconds stand on several lines each ({repeated}); if their fractions are in the next"
            " column, write each stamp as one number"
        )
    logger.warning("%s: %d lines repeat a stamp; of each the first is used", path, again)
    return first


def _explain(path: Path, text: str, columns: Sequence[int]) -> NoReturn:
    """Finds the first bad line and says what is wrong with it; slow, only taken when something is."""
    previous_ns, previous_line, width = None, 0, 0
    for line, content in enumerate(text.splitlines(), start=1):
        words = content.partition("#")[0].split()
        if not words:
            continue
        width = width or len(words)
        at_ns = _check_line(f"{path}, line {line}", words, columns, width)
        if previous_ns is not None and at_ns < previous_ns:
            raise InputError(
                f"{path}, line {line}: stamp {words[columns[0]]} is before that of line {previous_line};"
                " sort the file by its stamps"
            )
        previous_ns, previous_line = at_ns, line
    raise InputError(f"{path} is not a TUM trajectory: expected {' '.join(COLUMNS)} on each line")


def _check_line(place: str, words: list[str], columns: Sequence[int], width: int) -> int:
    """The stamp of one line in nanoseconds."""
    if len(words) <= max(columns) or len(words) != width == len(COLUMNS):
        hint = " separated by spaces" if "," in "".join(words) else ""
        raise InputError(
            f"{place}: expected {max(columns) + 1} numbers ({' '.join(COLUMNS)}){hint}, found {len(words)}"
        )
    stamp, *pose = (words[column] for column in columns)
    try:
        at_ns = nanoseconds(stamp)
    except ValueError as error:
        try:
            at_ns = stamp_ns(stamp, "auto")
        except ValueError:
            raise InputError(f"{place}: stamp {error}; expected seconds") from None
    numbers = np.array([_number(place, name, word) for name, word in zip(COLUMNS[1:], pose, strict=True)])
    if not np.abs(numbers[3:]).max() < LONGEST_QUATERNION:
        raise InputError(f"{place}: the quaternion is far from length one; expected qx qy qz qw")
    if np.linalg.norm(numbers[3:]) < 1e-9:
        raise InputError(f"{place}: the quaternion is zero; expected qx qy qz qw of length one (no rotation: 0 0 0 1)")
    return at_ns


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
