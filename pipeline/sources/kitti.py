"""KITTI recordings: odometry sequences and raw drives."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.stamps import nanoseconds
from wiclosure.pipeline.sources.files import read_bin
from wiclosure.pipeline.sources.messages.point_times import PointClock
from wiclosure.pipeline.sources.messages.pointcloud2 import timed_scan
from wiclosure.types import IntArray, Scan

_LAYOUTS = (("velodyne", "times.txt"), ("velodyne_points/data", "velodyne_points/timestamps.txt"))


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
        InputError: no scans, no times, or fewer times than scans.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.scan_files, self.stamps_ns = kitti_scans(path)

    @property
    def description(self) -> str:
        """One line for the user."""
        return f"KITTI folder {self.path}, {len(self.scan_files)} scans"

    def __len__(self) -> int:
        """Number of scan files."""
        return len(self.scan_files)

    def __iter__(self) -> Iterator[Scan]:
        """The scans in the order of their numbers."""
        for file, stamp_ns in zip(self.scan_files, self.stamps_ns.tolist(), strict=True):
            cloud = read_bin(file)
            yield timed_scan(PointClock(), stamp_ns, cloud.points, None, cloud.intensity)


def kitti_scans(path: Path) -> tuple[list[Path], IntArray]:
    """Scan files of a sequence or drive in order, and their stamps `(N,)` in nanoseconds.

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
    files = sorted(folder.glob("*.bin"))
    if not files:
        raise InputError(f"{folder} holds no .bin scans; copy them there or choose another folder")
    stamps_ns = read_times(times_file)
    return files, stamps_ns[rows_of_scans(files, len(stamps_ns), times_file, "times")]


def rows_of_scans(files: Sequence[Path], count: int, path: Path, what: str) -> IntArray:
    """The line `(N,)` of each scan in a file of `count` lines, one a scan.

    By order when there are as many as scans, else by the scan's number: some raw drives miss scans.

    Raises:
        InputError: there are fewer lines than scans.
    """
    if len(files) == count:
        return np.arange(count)
    numbers = [int(file.stem) for file in files if file.stem.isdigit()]
    if len(numbers) == len(files) and max(numbers) < count:
        return np.array(numbers, np.int64)
    raise InputError(
        f"{path} has {count} {what} for {len(files)} scans (the last is {files[-1].name});"
        " complete it, or remove the scans beyond its end"
    )


def read_times(path: Path) -> IntArray:
    """Stamps `(N,)` in nanoseconds, from seconds or from dates (`2011-09-26 13:02:25.594360375`), one a line.

    Raises:
        InputError: the file is missing or a line is neither.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(
            f"cannot read {path}: {error.strerror}; a KITTI folder needs it (one time in seconds for each scan)."
            " To take 10 scans a second instead, name the folder of the .bin files"
        ) from error
    except UnicodeDecodeError:
        raise InputError(f"{path} is not text; expected one time in seconds for each scan") from None
    return np.array(
        [_stamp(path, number, line.strip()) for number, line in enumerate(lines, start=1) if line.strip()], np.int64
    )


def _stamp(path: Path, number: int, text: str) -> int:
    try:
        if "-" in text and ":" in text:
            return int(np.datetime64(text.replace(" ", "T"), "ns").astype(np.int64))
        return nanoseconds(text)
    except ValueError:
        raise InputError(f"{path}, line {number}: {text!r} is no time; expected seconds or a date with time") from None
