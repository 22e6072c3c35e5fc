"""Splits one KITTI drive into several robots that each drive a part of it.

Every part becomes a KITTI folder whose clock starts when the first part's does, as if all robots had set out together.
The scans themselves are linked, not copied.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.stamps import seconds_text
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.data.dataset import Dataset, load_dataset
from wiclosure.pipeline.data.dataset_file import DATASET_FILE, WIRELESS_FILE, write_dataset
from wiclosure.pipeline.data.ground_truth import kitti_ground_truth
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.runtime.output import whole_folder
from wiclosure.pipeline.sources.kitti import KittiSource, sequence_folders
from wiclosure.types import IntArray, Trajectory, WirelessLog

logger = logging.getLogger(__name__)

ROBOT_NAMES = ("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa")
SPLIT_FILE = "split.json"

HeardBy = Callable[[Dataset], WirelessLog]
"""Makes up what the robots of a data set would have heard of each other; their ground truth is in the data set."""


@dataclass(frozen=True, slots=True)
class DrivePart:
    """Which scans of the drive a robot has, and how its clock was moved.

    Args:
        first, last: numbers of its scans in the drive, `last` included.
        time_shift_ns: added to the drive's stamps.
    """

    first: int
    last: int
    time_shift_ns: int


def split_kitti(
    drive: Path,
    robots: int,
    out: Path,
    *,
    overlap: float = 0.0,
    heard: HeardBy | None = None,
    overwrite: bool = False,
) -> Dataset:
    """Writes a data set of several robots from one KITTI sequence or raw drive; the folder appears whole or not at all.

    Args:
        drive: folder of the sequence; see `find_sequence`.
        robots: how many, at least 2.
        out: folder to write: `<robot>/`, `<robot>_gt.tum` (one world for all), `dataset.yaml`, `split.json`.
        overlap: share of each part, in [0, 1), that the next robot drives as well (on the same scans).
        heard: makes the wireless log (`wireless.jsonl`) from the finished recordings and their ground truth.
        overwrite: replace an existing folder.

    Raises:
        InputError: the drive is malformed or too short.
        ConfigError: robots or overlap out of range.
        OutputError: `out` exists or cannot be written.
    """
    source = KittiSource(drive)
    truth = kitti_ground_truth(source.path, "world")
    if truth is None:
        without = "no ground truth" if heard is None else "no ground truth, and no radio is simulated"
        logger.warning("%s has no poses: the robots have %s", source.path, without)
    parts = contiguous_parts(source.stamps_ns, robots, overlap)
    with whole_folder(out, overwrite=overwrite) as scratch:
        recordings = {robot: _write_robot(scratch, robot, part, source, truth) for robot, part in parts.items()}
        logs: list[RadioSource] = []
        if heard is not None and truth is not None:
            write_wireless_log(scratch / WIRELESS_FILE, heard(Dataset(recordings)))
            logs.append(RadioSource(path=scratch / WIRELESS_FILE))
        write_dataset(scratch / DATASET_FILE, recordings, logs)
        _write_record(scratch / SPLIT_FILE, source.path, parts)
    return load_dataset([str(out / DATASET_FILE)])


def find_sequence(kitti_dir: Path, sequence: str | None) -> Path:
    """The folder of a sequence or drive.

    Raises:
        InputError: there is none of that name; lists those that there are.
    """
    if sequence is None:
        return kitti_dir
    choices = sequence_folders(kitti_dir)
    for folder in (*choices, kitti_dir):
        if folder.absolute().name == sequence:
            return folder
    known = ", ".join(folder.name for folder in choices) or "none"
    raise InputError(f"{kitti_dir} has no KITTI sequence {sequence!r}; it has {known}")


def contiguous_parts(stamps_ns: IntArray, robots: int, overlap: float) -> dict[str, DrivePart]:
    """Parts of equal length in order; neighbours share `overlap` of their length.

    Raises:
        ConfigError, InputError: see `split_kitti`.
    """
    if robots < 2:
        raise ConfigError(f"--robots is {robots}; a drive is split between at least 2")
    if not 0 <= overlap < 1:
        raise ConfigError(f"--overlap is {overlap}; it must be at least 0 and below 1")
    count = len(stamps_ns)
    if count < 2 * robots:
        raise InputError(f"the drive has {count} scans, too few for {robots} robots; take fewer robots")
    length = count / (robots - (robots - 1) * overlap)
    firsts = [round(number * length * (1 - overlap)) for number in range(robots)]
    parts = {}
    for number, (first, following) in enumerate(pairwise([*firsts, count])):
        last = min(max(round(number * length * (1 - overlap) + length), first + 1, following), count) - 1
        name = ROBOT_NAMES[number] if number < len(ROBOT_NAMES) else f"robot_{number}"
        parts[name] = DrivePart(first, last, int(stamps_ns[0] - stamps_ns[first]))
    return parts


def _write_robot(
    folder: Path, robot: str, part: DrivePart, source: KittiSource, truth: Trajectory | None
) -> RobotRecording:
    """The robot's KITTI folder and ground truth."""
    scans = folder / robot
    (scans / "velodyne").mkdir(parents=True)
    stamps_ns = source.stamps_ns[part.first : part.last + 1]
    for number, file in enumerate(source.scan_files[part.first : part.last + 1]):
        _link(file.resolve(), scans / "velodyne" / f"{number:06d}.bin")
    (scans / "times.txt").write_text("".join(f"{t}\n" for t in seconds_text((stamps_ns + part.time_shift_ns).tolist())))
    if truth is None:
        return RobotRecording(scans)
    mine = (truth.stamps_ns >= stamps_ns[0]) & (truth.stamps_ns <= stamps_ns[-1])
    moved = Trajectory(robot, truth.stamps_ns[mine] + part.time_shift_ns, truth.poses[mine])
    write_tum(folder / f"{robot}_gt.tum", moved)
    return RobotRecording(scans, ground_truth=folder / f"{robot}_gt.tum")


def _link(file: Path, target: Path) -> None:
    """A hard link; a symbolic one on another disk; a copy where neither is possible."""
    for make in (os.link, os.symlink):
        try:
            make(file, target)
        except OSError:
            continue
        return
    shutil.copyfile(file, target)


def _write_record(path: Path, drive: Path, parts: Mapping[str, DrivePart]) -> None:
    """What was done, so that nobody takes the moved clocks for recorded ones."""
    record = {
        "drive": drive.absolute().name,
        "note": "time_shift_ns was added to the drive's stamps so that all robots start together",
        "robots": {robot: asdict(part) for robot, part in parts.items()},
    }
    path.write_text(json.dumps(record, indent=2) + "\n", encoding="utf-8")
