"""`dataset.yaml`, read and written.

```yaml
robots:
  alpha: {scans: alpha.bag, topic: /points, ground_truth: alpha_gt.tum, time_offset: 0.0}
  beta:  {scans: beta_bag/, topic: /points, ground_truth: beta_gt.tum}
wireless: [wireless.jsonl]            # and/or topics inside the bags
```
Paths are relative to the file.  `robot_keys` says what a robot may have, `RadioSource` what a wireless source may; the
reference in docs/dataset.md is made of both (`wiclosure.pipeline.data.dataset_reference`).
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml

from wiclosure.errors import InputError, OutputError
from wiclosure.formats.structured_text import read_yaml
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.data.robot_keys import ROBOT_KEYS, mapping, text
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.radio.words import sources_of_entries
from wiclosure.pipeline.sources.bag_files import bag_kind

DATASET_FILE = "dataset.yaml"
WIRELESS_FILE = "wireless.jsonl"


def read_dataset_file(path: Path) -> tuple[dict[str, RobotRecording], tuple[RadioSource, ...]]:
    """Recordings by robot, and radio logs; all of them exist.

    Raises:
        InputError: the file cannot be read, is not as described above, or names files that do not exist.
    """
    content = mapping(path, "the file", read_yaml(path), known=("robots", "wireless"))
    if "robots" not in content:
        raise InputError(f'{path} has no "robots"; name them as robots: {{alpha: {{scans: alpha.bag}}}}')
    robots = {
        text(path, "a robot's name", robot): _robot(path, str(robot), entry)
        for robot, entry in mapping(path, '"robots"', content["robots"]).items()
    }
    return robots, sources_of_entries(content.get("wireless"), path.parent, str(path))


def write_dataset(path: Path | str, robots: Mapping[str, RobotRecording], wireless: Iterable[RadioSource] = ()) -> None:
    """Writes a data set file; paths become relative to it where they lie beside or below it.

    Args:
        path: the file.
        robots: recordings by name of the robot, in order.
        wireless: radio logs.

    Raises:
        OutputError: the file cannot be written.
    """
    path = Path(path)
    entries = {robot: _entry(path.parent, recording) for robot, recording in robots.items()}
    content: dict[str, Any] = {"robots": entries}
    if logs := [_radio(path.parent, source) for source in wireless]:
        content["wireless"] = logs
    try:
        path.write_text(yaml.safe_dump(content, sort_keys=False, allow_unicode=True), encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write the data set {path}: {error.strerror}; choose another place") from error


# ------------------------------------------------------------------------------------------------------------- reading
def _robot(path: Path, robot: str, entry: object) -> RobotRecording:
    where = f"robot {robot}"
    if isinstance(entry, str):
        raise InputError(
            f"{path}: {where} is {entry[:80]!r}; expected keys with values, as {robot}: {{scans: {entry[:80]}}}"
        )
    keys = mapping(path, where, entry, known=tuple(ROBOT_KEYS))
    if keys.get("scans") is None:
        raise InputError(f'{path}: {where} has no "scans"; name its bag or folder')
    values = {
        key: ROBOT_KEYS[key].read(path, f'"{key}" of {where}', value)
        for key, value in keys.items()
        if value is not None
    }
    recording = RobotRecording(**values)
    if recording.odometry and recording.odometry_topic and bag_kind(recording.odometry) is None:
        raise InputError(f'{path}: {where} has "odometry" and "odometry_topic", but the first is no bag; name one')
    if bag_kind(recording.scans) is None:
        for key, topics in (("ranges", recording.ranges), ("ignored_radio", recording.ignored_radio)):
            if topics:
                raise InputError(
                    f'{path}: {where} has "{key}", topics of its bag, but {recording.scans.name} is no bag; leave it'
                    " out, and name logs under wireless"
                )
    return recording


# ------------------------------------------------------------------------------------------------------------- writing
def _entry(folder: Path, recording: RobotRecording) -> dict[str, Any]:
    """What is said of one robot, keys of their defaults left out."""
    entry: dict[str, Any] = {}
    for key in ROBOT_KEYS:
        match getattr(recording, key):
            case None | 0.0:
                continue
            case Path() as path:
                entry[key] = _relative(folder, path)
            case Mapping() as pairs:
                entry |= {key: dict(pairs)} if pairs else {}
            case tuple() as several:
                entry |= {key: list(several)} if several else {}
            case value:
                entry[key] = value
    return entry


def _radio(folder: Path, source: RadioSource) -> str | dict[str, Any]:
    """A path alone, or what is stated of the source."""
    stated = source.model_dump(mode="json", exclude_unset=True, by_alias=True)
    if source.path is not None:
        stated["path"] = _relative(folder, source.path)
    return stated["path"] if stated.keys() == {"path"} else stated


def _relative(folder: Path, path: Path) -> str:
    """Relative to the folder where it lies below, so that the data set can be moved as a whole."""
    inside = path.absolute().is_relative_to(folder.absolute())
    return os.path.relpath(path.absolute(), folder.absolute()) if inside else str(path.absolute())
