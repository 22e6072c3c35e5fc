"""KITTI recordings: odometry sequences and raw drives."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.plausible import few
from wiclosure.pipeline.sources.clouds.bin import check_layout, read_bin
from wiclosure.pipeline.sources.clouds.file_stamps import natural
from wiclosure.pipeline.sources.clouds.times_file import read_lines
from wiclosure.pipeline.sources.messages.timed_scans import TimedScans
from wiclosure.types import IntArray, Scan

logger = logging.getLogger(__name__)

_LAYOUTS = (("velodyne", "times.txt"), ("velodyne_points/data", "velodyne_points/timestamps.txt"))

ELEVATION_CORRECTION_DEG = 0.205
"""By how much the beams of KITTI's LiDAR look higher than its calibration says; KISS-ICP's own readers of KITTI apply
the same."""


def is_kitti_folder(path: Path) -> bool:
    """Whether the folder is a KITTI sequence, a raw drive, or holds such."""
    return path.is_dir() and (any((path / scans).is_dir() for scans, _ in _LAYOUTS) or bool(sequence_folders(path)))


def sequence_folders(path: Path) -> list[Path]:
    """The sequences or drives in a folder of several (`dataset/sequences/00`, `2011_09_26/..._sync`)."""
    parents = [path / "sequences", path]
    folders = [folder for parent in parents if parent.is_dir() for folder in parent.iterdir() if folder.is_dir()]
    return sorted(folder for folder in folders if any((folder / scans).is_dir() for scans, _ in _LAYOUTS))


class KittiSource:
    """A KITTI odometry sequence (`velodyne/*.bin`, `times.txt`) or raw drive (`velodyne_points/`).

    Scans of both come motion-corrected (odometry) or without per-point times (raw): `Scan.times` is None.

    Args:
        path: folder of the sequence or drive.

    Raises:
        InputError: no scans, no times, fewer times than scans, or records of another layout.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.scan_files, self.scan_numbers, self.stamps_ns = kitti_scans(path)
        check_layout(self.scan_files[0])

    @property
    def description(self) -> str:
        """One line for the user."""
        return f"KITTI folder {self.path}, {len(self.scan_files)} scans"

    def __len__(self) -> int:
        """Number of scan files."""
        return len(self.scan_files)

    def __iter__(self) -> Iterator[Scan]:
        """The scans in the order of their numbers."""
        scan = TimedScans(str(self.path))
        for file, stamp_ns in zip(self.scan_files, self.stamps_ns.tolist(), strict=True):
            cloud = read_bin(file)
            yield scan(stamp_ns, cloud.points, None, cloud.intensity)


def kitti_scans(path: Path) -> tuple[list[Path], IntArray, IntArray]:
    """Scan files of a sequence or drive in order, their numbers `(N,)`, and their stamps `(N,)` in nanoseconds.

    A scan's number is that in its name, and its line in the file of times; blank lines there are scans that the drive
    misses.

    Raises:
        InputError: see `KittiSource`.
    """
    layout = next(((path / scans, path / times) for scans, times in _LAYOUTS if (path / scans).is_dir()), None)
    if layout is None:
        several = ", ".join(str(folder) for folder in sequence_folders(path)[:12])
        raise InputError(
            f"{path} holds several KITTI sequences; name one of them: {several}" if several else
            f"{path} is not a KITTI folder; expected velodyne/ and times.txt, or velodyne_points/data"
        )  # fmt: skip
    folder, times_file = layout
    files = sorted(folder.glob("[!.]*.bin"), key=lambda file: natural(file.name))  # hidden ones are of other systems
    if not files:
        raise InputError(f"{folder} holds no .bin scans; copy them there or choose another folder")
    lines = read_lines(times_file)
    stamps = {number: stamp for number, stamp in enumerate(lines) if stamp is not None}
    files = _with_times(files, stamps, len(lines), times_file)
    numbers = scan_numbers(files, list(stamps), len(lines), times_file, "times")
    return files, numbers, np.array([stamps[number] for number in numbers.tolist()], np.int64)


def _with_times(files: list[Path], known: Mapping[int, int], lines: int, path: Path) -> list[Path]:
    """The scans without those few whose own line is blank."""
    numbers = [int(file.stem) if file.stem.isdecimal() else lines for file in files]
    without = [number for number in numbers if number not in known]
    if len(files) == len(known) or not without or max(without) >= lines or not few(len(without), len(files)):
        return files
    logger.warning(
        "%s: %d scans have no time, as that of line %d; they are left out", path, len(without), without[0] + 1
    )
    return [file for file, number in zip(files, numbers, strict=True) if number in known]


def scan_numbers(files: Sequence[Path], known: Sequence[int], lines: int, path: Path, what: str) -> IntArray:
    """The line `(N,)` of each scan in a file of so many lines, of which those `known` hold something.

    By the number in the scan's name where all such lines are known; else, where there are as many scans as known lines,
    by their order: scans were renumbered, or named otherwise.

    Raises:
        InputError: neither fits.
    """
    numbers = [int(file.stem) for file in files if file.stem.isdecimal()]
    if len(numbers) == len(files) and set(numbers) <= set(known):
        return np.array(numbers, np.int64)
    if len(files) == len(known):
        return np.array(known, np.int64)
    blank = f" ({lines - len(known)} of its lines are blank)" if lines > len(known) else ""
    raise InputError(
        f"{path} has {len(known)} {what} for {len(files)} scans (the last is {files[-1].name}){blank};"
        " complete it, or remove the scans beyond its end"
    )
