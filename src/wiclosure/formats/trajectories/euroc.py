"""Trajectories as EuRoC writes its ground truth: comma separated, `stamp [ns], x, y, z, qw, qx, qy, qz, ...` a line.

Where a line of names tells another order of the pose (`qx qy qz qw`), that order is read.
"""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.errors import InputError
from wiclosure.formats.plausible import LATEST_NS, LONGEST_QUATERNION, plausible_path
from wiclosure.formats.radio.radio_units import TimeUnit, stamp_ns, stamp_unit_of
from wiclosure.formats.text_cells import is_number
from wiclosure.formats.text_table import encoding_of
from wiclosure.formats.trajectories.pose_columns import line_of_names, pose_columns, stated_unit
from wiclosure.types import Trajectory

_ORDER = ("stamp", "x", "y", "z", "qw", "qx", "qy", "qz")
_COLUMNS = 8  # further ones (velocity, biases) are not used
_EARLIEST_NS = 10**14  # a whole number below this counts no nanoseconds since 1970


def is_euroc(line: str) -> bool:
    """Whether a line of data is EuRoC's: at least eight numbers between commas, the first whole nanoseconds."""
    words = [word.strip() for word in line.split(",")]
    numbers = (
        len(words) >= _COLUMNS
        and words[0].isdecimal()
        and len(words[0]) < 20
        and all(map(is_number, words[1:_COLUMNS]))
    )
    return numbers and int(words[0]) >= _EARLIEST_NS


def _is_pose(row: list[float]) -> bool:
    """Whether numbers x, y, z and of a quaternion are finite, and the last four no zero."""
    return bool(np.isfinite(row).all() and 1e-9 <= max(map(abs, row[3:])) < LONGEST_QUATERNION)


def _nanoseconds(stamp: str, stated: TimeUnit | None) -> int:
    """A whole number in the stated unit, else of nanoseconds, or of ticks of a clock that its size tells."""
    if stated is not None:
        return stamp_ns(stamp, stated)
    unit = stamp_unit_of(Decimal(int(stamp)))
    return stamp_ns(stamp, unit if unit in {"filetime", "dotnet"} else "ns")


def read_euroc(path: Path | str, robot: str, drift: DriftModel | None = None) -> Trajectory:
    """The trajectory in a EuRoC file (`state_groundtruth_estimate0/data.csv`).

    Args:
        path: the file; lines that begin with `#`, and a line of names, are passed over.
        robot: name that the trajectory carries.
        drift: drift model that the trajectory carries.

    Raises:
        InputError: the file cannot be read, or a line is malformed, not finite, or goes back in time.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding=encoding_of(path))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"cannot read the trajectory {path}: {error}; check the file") from error
    names = line_of_names(text)
    stamp_column, *pose = pose_columns(path, names, _ORDER)
    unit = stated_unit(names)
    stamps_ns: list[int] = []
    rows: list[list[float]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith("#") or (not rows and not is_euroc(line)):
            continue
        words = [word.strip() for word in line.split(",")]
        try:
            row = [float(words[column]) for column in pose]
            at_ns = _nanoseconds(words[stamp_column], unit)
        except (ValueError, IndexError):
            row, at_ns = [], 0
        if len(row) < _COLUMNS - 1 or at_ns > LATEST_NS or not _is_pose(row):
            raise InputError(f"{path}, line {number}: expected stamp [ns], x, y, z, qw, qx, qy, qz")
        if stamps_ns and at_ns < stamps_ns[-1]:
            raise InputError(
                f"{path}, line {number}: stamp {words[stamp_column]} is before the one above; sort the file"
            )
        if not stamps_ns or at_ns > stamps_ns[-1]:
            stamps_ns.append(at_ns)
            rows.append(row)
    if not rows:
        raise InputError(f"{path} holds no poses; expected stamp [ns], x, y, z, qw, qx, qy, qz a line")
    numbers, times_ns = np.array(rows), np.array(stamps_ns, np.int64)
    near = plausible_path(path, times_ns, numbers[:, :3])
    numbers, times_ns = numbers[near], times_ns[near]
    rotation = Rotation.from_quat(numbers[:, 3:]).as_matrix()
    poses = se3.from_rotation_translation(rotation, numbers[:, :3])
    return Trajectory(robot, times_ns, poses, drift or DriftModel())
