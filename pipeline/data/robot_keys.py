"""What `dataset.yaml` may say of a robot: each key, what it means, and how its value is read."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from wiclosure.errors import InputError
from wiclosure.formats.radio.radio_units import METRES
from wiclosure.frontends.config import OdometrySettings
from wiclosure.pipeline.data.navigation.imu_units import ACCELERATION_UNITS, RATE_UNITS
from wiclosure.pipeline.runtime.paths import exists, expanded, is_endless
from wiclosure.pipeline.sources.clouds.bin import LAYOUTS, record_type
from wiclosure.suggestions import did_you_mean


def mapping(path: Path, what: str, value: object, known: Sequence[str] = ()) -> Mapping[str, Any]:
    """Keys with values.

    Raises:
        InputError: it is something else, or has a key that is not known.
    """
    if not isinstance(value, dict):
        raise InputError(f"{path}: {what} is {_shown(value)}; expected keys with values, see docs/dataset.md")
    for key in value:
        if known and key not in known:
            hint = did_you_mean(str(key), known)
            raise InputError(f"{path}: {what} has the unknown key {key!r}; {hint}known: {', '.join(known)}")
    return value


def _existing(path: Path, what: str, value: object) -> Path:
    file = path.parent / expanded(text(path, what, value))
    if not exists(file):
        raise InputError(f"{path}: {what} names {file}, which does not exist; paths are relative to the data set file")
    return _beside(path, what, value)


def text(path: Path, what: str, value: object) -> str:
    """A text.

    Raises:
        InputError: it is something else, or empty.
    """
    if not isinstance(value, str) or not value:
        raise InputError(f"{path}: {what} is {_shown(value)}; expected text (in quotes if it looks like a number)")
    return value


def _beside(path: Path, what: str, value: object) -> Path:
    """A file that need not exist: ground truth that is missing is said when it is read, and stops nothing."""
    file = path.parent / expanded(text(path, what, value))
    if is_endless(file):
        raise InputError(f"{path}: {what} names {file}, which is neither a file nor a folder; name one")
    return file


def _settings(path: Path, what: str, value: object) -> dict[str, object]:
    chosen = dict(mapping(path, what, value, known=tuple(OdometrySettings.model_fields)))
    try:
        OdometrySettings.model_validate(chosen)
    except ValidationError as error:
        problem = error.errors()[0]
        raise InputError(f"{path}: {what}: {'.'.join(map(str, problem['loc']))}: {problem['msg']}") from None
    return chosen


def _unit(path: Path, what: str, value: object) -> str:
    if value not in METRES:
        raise InputError(f"{path}: {what} is {_shown(value)}; expected {', '.join(METRES)}")
    return str(value)


def _layout(path: Path, what: str, value: object) -> str:
    layout = text(path, what, value)
    try:
        record_type(layout)
    except InputError as error:
        raise InputError(f"{path}: {what}: {error}") from None
    return layout


def _seconds(path: Path, what: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{path}: {what} is {_shown(value)}; expected a number of seconds")
    return float(value)


def _ranges(path: Path, what: str, value: object) -> dict[str, str]:
    pairs = mapping(path, what, value)
    return {text(path, what, topic): text(path, what, transmitter) for topic, transmitter in pairs.items()}


def _topics(path: Path, what: str, value: object) -> tuple[str, ...]:
    if not isinstance(value, list):
        raise InputError(f"{path}: {what} is {_shown(value)}; expected a list of topics, as [/uwb]")
    return tuple(text(path, f"a topic of {what}", topic) for topic in value)


def _pose(path: Path, what: str, value: object) -> tuple[float, ...]:
    numbers = value if isinstance(value, list) else []
    good = [isinstance(n, int | float) and not isinstance(n, bool) and math.isfinite(n) for n in numbers]
    if len(numbers) != 7 or not all(good):
        raise InputError(f"{path}: {what} is {_shown(value)}; expected seven numbers [x, y, z, qx, qy, qz, qw]")
    if not any(numbers[3:]):
        raise InputError(f"{path}: {what} is {_shown(value)}; its quaternion is zero (no rotation: 0, 0, 0, 1)")
    return tuple(float(n) for n in numbers)


def _position(path: Path, what: str, value: object) -> tuple[float, ...]:
    numbers = value if isinstance(value, list) else []
    good = [isinstance(n, int | float) and not isinstance(n, bool) and math.isfinite(n) for n in numbers]
    if len(numbers) != 3 or not all(good):
        raise InputError(f"{path}: {what} is {_shown(value)}; expected three numbers [x, y, z]")
    return tuple(float(n) for n in numbers)


def _imu_units(path: Path, what: str, value: object) -> tuple[str, ...]:
    words = [str(word) for word in value] if isinstance(value, list) else []
    if len(words) != 2 or words[0] not in ACCELERATION_UNITS or words[1] not in RATE_UNITS:
        raise InputError(
            f"{path}: {what} is {_shown(value)}; expected one of {', '.join(ACCELERATION_UNITS)} and one of"
            f" {', '.join(RATE_UNITS)}, as [g, deg/s]"
        )
    return tuple(words)


@dataclass(frozen=True, slots=True)
class RobotKey:
    """One key of a robot's entry.

    Args:
        read: makes the value of `RobotRecording` of what YAML gives.
        kind: what is expected, for the reference.
        meaning: with units, signs and defaults, for the reference.
    """

    read: Callable[[Path, str, object], Any]
    kind: str
    meaning: str


ROBOT_KEYS: Mapping[str, RobotKey] = {
    "scans": RobotKey(_existing, "path", "required: a bag, KITTI folder or folder of clouds (see docs/recordings.md)"),
    "topic": RobotKey(text, "text", "topic of the point clouds; not needed where the bag has only one"),
    "layout": RobotKey(
        _layout,
        "text",
        f"what the records of `.bin` files hold: {', '.join(f'`{name}`' for name in LAYOUTS)}, or fields in their order"
        " as `x y z intensity time:u4` (float32 where no type is said); default `kitti`",
    ),
    "scan_unit": RobotKey(
        _unit, "unit", "of the coordinates in the clouds: m, mm, cm, dm, km, ft or in; default m, which is looked at"
    ),
    "ground_truth": RobotKey(
        _beside,
        "path",
        "true poses of the body in one world for all robots, only to measure errors: TUM (`stamp x y z qx qy qz qw`,"
        " seconds, metres), EuRoC, KITTI poses (a line for each scan of a folder), or a bag; a KITTI folder brings its"
        " own. What cannot be read is said and left out",
    ),
    "ground_truth_topic": RobotKey(
        text,
        "text",
        "topic of the true poses, in the bag that `ground_truth` names or else in that of the scans: odometry, poses or"
        " transforms, of several transforms with its frames, as `/tf world->alpha`",
    ),
    "time_offset": RobotKey(
        _seconds,
        "seconds",
        "**added** to every stamp of this robot: scans, odometry, ground truth, and radio that it received; a robot"
        " whose clock is 0.2 s ahead of the others' takes -0.2; default 0",
    ),
    "ranges": RobotKey(
        _ranges, "topic: robot", "whom it measured on each `sensor_msgs/Range` topic of its bag, as `{/uwb_2: beta}`"
    ),
    "ignored_radio": RobotKey(
        _topics,
        "[topic]",
        "radio topics of its bag that are left out, as where a log under `wireless` holds the same: `[/uwb]`",
    ),
    "odometry": RobotKey(
        _existing,
        "path",
        "its own odometry, TUM, EuRoC or a bag, in the place of KISS-ICP's; stamps in the clock of the scans, positions"
        " in metres from anywhere (UTM too)",
    ),
    "odometry_topic": RobotKey(
        text,
        "text",
        "its topic, in the bag that `odometry` names or else in that of the scans; as `ground_truth_topic`",
    ),
    "odometry_settings": RobotKey(
        _settings,
        "setting: value",
        "settings of `odometry` for this robot alone, as `{max_range_m: 40}`; they go before the configuration's",
    ),
    "imu": RobotKey(
        _existing,
        "path",
        "its inertial measurements: a bag, a table (stamp, acceleration x y z, turning rate x y z; or named, as"
        " EuRoC's) or KITTI's `oxts` folder; default: the only `sensor_msgs/Imu` topic of its bag, or the `oxts` of its"
        " drive",
    ),
    "imu_topic": RobotKey(text, "text", "its topic, in the bag that `imu` names or else in that of the scans"),
    "imu_pose": RobotKey(
        _pose,
        "[x, y, z, qx, qy, qz, qw]",
        "pose of the IMU in the LiDAR's frame, metres; default: what static transforms in the bag say, else the axes"
        " are found from turning rates and gravity, and what was found is said",
    ),
    "imu_units": RobotKey(
        _imu_units,
        "[text, text]",
        "units of acceleration (`m/s^2`, `g`, `mg`) and turning rate (`rad/s`, `deg/s`); default `[m/s^2, rad/s]`",
    ),
    "imu_time_offset": RobotKey(
        _seconds, "seconds", "**added** to the IMU's stamps to give the clock of the scans; default 0"
    ),
    "gnss": RobotKey(
        _existing,
        "path",
        "positions on the Earth: a bag, a table (stamp, latitude, longitude, height; degrees and metres) or KITTI's"
        " `oxts` folder; the merged map is then in metres east, north and up of the first of them",
    ),
    "gnss_topic": RobotKey(
        text, "text", "its `sensor_msgs/NavSatFix` topic, in the bag that `gnss` names or else in that of the scans"
    ),
    "gnss_antenna": RobotKey(
        _position, "[x, y, z]", "the antenna in the LiDAR's frame, metres; default: where the LiDAR is"
    ),
    "lidar_pose": RobotKey(
        _pose,
        "[x, y, z, qx, qy, qz, qw]",
        "pose of the LiDAR in the body frame of that odometry, metres; default: what static transforms in the bag say,"
        " else they are the same",
    ),
}


def _shown(value: object) -> str:
    return "empty" if value is None else repr(value)[:60]
