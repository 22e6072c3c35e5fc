"""`dataset.yaml`, read and written.

```yaml
robots:
  alpha: {scans: alpha.bag, topic: /points, ground_truth: alpha_gt.tum, time_offset: 0.0}
  beta:  {scans: beta_bag/, topic: /points, ground_truth: beta_gt.tum}
wireless: [wireless.jsonl]            # and/or topics inside the bags
```
Paths are relative to the file.  A robot may also say `ranges: {/uwb_2: beta}`: whom it ranges on which
`sensor_msgs/Range` topic of its bag.  With odometry of its own, `odometry: alpha_odom.tum`, or `odometry_topic: /odom`
(`nav_msgs/Odometry` in its bag), KISS-ICP is left out; `lidar_pose: [x, y, z, qx, qy, qz, qw]` is the pose of the
LiDAR in the body frame of that odometry.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from wiclosure.errors import InputError, OutputError
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.suggestions import did_you_mean

DATASET_FILE = "dataset.yaml"
WIRELESS_FILE = "wireless.jsonl"


def read_dataset_file(path: Path) -> tuple[dict[str, RobotRecording], tuple[Path, ...]]:
    """Recordings by robot, and wireless logs; all of them exist.

    Raises:
        InputError: the file cannot be read, is not as described above, or names files that do not exist.
    """
    content = _mapping(path, "the file", _load(path), known=("robots", "wireless"))
    if "robots" not in content:
        raise InputError(f'{path} has no "robots"; name them as robots: {{alpha: {{scans: alpha.bag}}}}')
    robots = {
        _text(path, "a robot's name", robot): _robot(path, str(robot), entry)
        for robot, entry in _mapping(path, '"robots"', content["robots"]).items()
    }
    logs = content.get("wireless") or []
    logs = [logs] if isinstance(logs, str) else logs
    if not isinstance(logs, list):
        raise InputError(f'{path}: "wireless" is {_shown(logs)}; expected a list of files')
    return robots, tuple(_existing(path, "wireless log", log) for log in logs)


def write_dataset(path: Path | str, robots: Mapping[str, RobotRecording], wireless: Iterable[Path] = ()) -> None:
    """Writes a data set file; paths become relative to it where they lie beside or below it.

    Args:
        path: the file.
        robots: recordings by name of the robot, in order.
        wireless: wireless logs.

    Raises:
        OutputError: the file cannot be written.
    """
    path = Path(path)
    entries = {robot: _entry(path.parent, recording) for robot, recording in robots.items()}
    content: dict[str, Any] = {"robots": entries}
    if logs := [_relative(path.parent, log) for log in wireless]:
        content["wireless"] = logs
    try:
        path.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write the data set {path}: {error.strerror}; choose another place") from error


# ------------------------------------------------------------------------------------------------------------- reading
class _Loader(yaml.SafeLoader):
    """Safe, and refuses a key that stands twice: YAML would let the last one win."""


def _unique_mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Hashable, Any]:
    seen: set[Hashable] = set()
    for key_node, _ in node.value:
        key = loader.construct_object(key_node, deep=True)
        if not isinstance(key, Hashable):
            raise yaml.constructor.ConstructorError(None, None, "a key is a list or mapping", key_node.start_mark)
        if key in seen:
            raise yaml.constructor.ConstructorError(
                None, None, f"{key!r} stands twice; give every robot its own name", key_node.start_mark
            )
        seen.add(key)
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _unique_mapping)


def _load(path: Path) -> object:
    try:
        return yaml.load(path.read_text(encoding="utf-8"), _Loader)
    except OSError as error:
        raise InputError(f"cannot read the data set {path}: {error.strerror}; check the path") from error
    except yaml.MarkedYAMLError as error:
        line = f", line {error.problem_mark.line + 1}" if error.problem_mark else ""
        raise InputError(f"{path}{line}: {error.problem or 'not valid YAML'}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is not valid YAML text: {' '.join(str(error).split())}") from error


def _robot(path: Path, robot: str, entry: object) -> RobotRecording:
    where = f"robot {robot}"
    keys = _mapping(path, where, entry, known=tuple(_VALUES))
    if keys.get("scans") is None:
        raise InputError(f'{path}: {where} has no "scans"; name its bag or folder')
    if keys.get("odometry") is not None and keys.get("odometry_topic") is not None:
        raise InputError(f'{path}: {where} has "odometry" and "odometry_topic"; name one')
    values = {key: _VALUES[key](path, f'"{key}" of {where}', value) for key, value in keys.items() if value is not None}
    return RobotRecording(**values)


def _mapping(path: Path, what: str, value: object, known: Sequence[str] = ()) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InputError(
            f"{path}: {what} is {_shown(value)}; expected keys with values, see {DATASET_FILE} in the README"
        )
    for key in value:
        if known and key not in known:
            hint = did_you_mean(str(key), known)
            raise InputError(f"{path}: {what} has the unknown key {key!r}; {hint}known: {', '.join(known)}")
    return value


def _existing(path: Path, what: str, value: object) -> Path:
    file = path.parent / Path(_text(path, what, value)).expanduser()
    if not file.exists():
        raise InputError(f"{path}: {what} names {file}, which does not exist; paths are relative to the data set file")
    return file


def _text(path: Path, what: str, value: object) -> str:
    if not isinstance(value, str) or not value:
        raise InputError(f"{path}: {what} is {_shown(value)}; expected text (in quotes if it looks like a number)")
    return value


def _seconds(path: Path, what: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{path}: {what} is {_shown(value)}; expected a number of seconds")
    return float(value)


def _ranges(path: Path, what: str, value: object) -> dict[str, str]:
    pairs = _mapping(path, what, value)
    return {_text(path, what, topic): _text(path, what, transmitter) for topic, transmitter in pairs.items()}


def _pose(path: Path, what: str, value: object) -> tuple[float, ...]:
    numbers = value if isinstance(value, list) else []
    good = [isinstance(n, int | float) and not isinstance(n, bool) and math.isfinite(n) for n in numbers]
    if len(numbers) != 7 or not all(good) or not any(numbers[3:]):
        raise InputError(f"{path}: {what} is {_shown(value)}; expected seven numbers [x, y, z, qx, qy, qz, qw]")
    return tuple(float(n) for n in numbers)


_VALUES: Mapping[str, Callable[[Path, str, object], Any]] = {
    "scans": _existing,
    "topic": _text,
    "ground_truth": _existing,
    "time_offset": _seconds,
    "ranges": _ranges,
    "odometry": _existing,
    "odometry_topic": _text,
    "lidar_pose": _pose,
}


def _shown(value: object) -> str:
    return "empty" if value is None else repr(value)[:60]


# ------------------------------------------------------------------------------------------------------------- writing
def _entry(folder: Path, recording: RobotRecording) -> dict[str, Any]:
    entry: dict[str, Any] = {"scans": _relative(folder, recording.scans)}
    if recording.topic is not None:
        entry["topic"] = recording.topic
    if recording.ground_truth is not None:
        entry["ground_truth"] = _relative(folder, recording.ground_truth)
    if recording.time_offset:
        entry["time_offset"] = recording.time_offset
    if recording.ranges:
        entry["ranges"] = dict(recording.ranges)
    if recording.odometry is not None:
        entry["odometry"] = _relative(folder, recording.odometry)
    if recording.odometry_topic is not None:
        entry["odometry_topic"] = recording.odometry_topic
    if recording.lidar_pose is not None:
        entry["lidar_pose"] = list(recording.lidar_pose)
    return entry


def _relative(folder: Path, path: Path) -> str:
    """Relative to the folder where it lies below, so that the data set can be moved as a whole."""
    inside = path.absolute().is_relative_to(folder.absolute())
    return os.path.relpath(path.absolute(), folder.absolute()) if inside else str(path.absolute())
