"""A folder of single clouds: PCD, PLY or BIN."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.stamps import nanoseconds
from wiclosure.pipeline.sources.files import CLOUD_READERS
from wiclosure.pipeline.sources.messages.point_times import PointClock
from wiclosure.pipeline.sources.messages.pointcloud2 import timed_scan
from wiclosure.types import IntArray, Scan

_PERIOD_NS = 100_000_000  # 10 Hz, the usual rate of spinning LiDARs
_SECONDS_AND_NANOSECONDS = re.compile(r"(\d+)[._](\d{9})")
_UNITS_NS = ((10**17, 1), (10**14, 10**3), (10**11, 10**6), (10**8, 10**9))
"""A whole number at least this large is a date in units of so many nanoseconds; a smaller one is a frame number."""


def is_cloud_folder(path: Path) -> bool:
    """Whether the folder holds cloud files."""
    return path.is_dir() and any(file.suffix.lower() in CLOUD_READERS for file in path.iterdir())


class FolderSource:
    """The `.pcd`, `.ply` or `.bin` files of a folder, in order of time.

    Stamps come from the file names: `1317042272.123456789` and `1317042272_123456789` are seconds; whole numbers of the
    size of a date are s, ms, us or ns since 1970; smaller ones are frame numbers at 10 Hz.  Other names are taken in
    alphabetical order at 10 Hz.

    Args:
        path: the folder.

    Raises:
        InputError: no cloud files, or several kinds of them.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        files = [file for file in sorted(path.iterdir()) if file.suffix.lower() in CLOUD_READERS]
        suffixes = sorted({file.suffix.lower() for file in files})
        if len(suffixes) != 1:
            found = f"holds {' and '.join(suffixes)} files" if suffixes else "holds no cloud files"
            raise InputError(f"{path} {found}; expected one kind of {', '.join(CLOUD_READERS)}")
        self._suffix = suffixes[0]
        stamps_ns, self._how = file_stamps([file.stem for file in files])
        order = np.argsort(stamps_ns, kind="stable")
        self.scan_files = [files[index] for index in order]
        self.stamps_ns = stamps_ns[order]

    @property
    def description(self) -> str:
        """One line for the user."""
        return f"folder {self.path}, {len(self.scan_files)} {self._suffix} scans, stamps: {self._how}"

    def __len__(self) -> int:
        """Number of scan files."""
        return len(self.scan_files)

    def __iter__(self) -> Iterator[Scan]:
        """The scans in order of time."""
        read, clock = CLOUD_READERS[self._suffix], PointClock()
        for file, stamp_ns in zip(self.scan_files, self.stamps_ns.tolist(), strict=True):
            yield timed_scan(clock, stamp_ns, *read(file))


def file_stamps(names: Sequence[str]) -> tuple[IntArray, str]:
    """Stamps `(N,)` in nanoseconds by file names without suffix, and in words how they were found."""
    split = [_SECONDS_AND_NANOSECONDS.fullmatch(name) for name in names]
    if all(split):
        return np.array([int(m[1]) * 10**9 + int(m[2]) for m in split if m], np.int64), "file names, seconds"
    if all(name.isdigit() for name in names):
        smallest = min(map(int, names))
        unit_ns = next((unit for size, unit in _UNITS_NS if smallest >= size), None)
        if unit_ns is None:
            return np.array([int(name) * _PERIOD_NS for name in names], np.int64), "frame numbers at 10 Hz"
        return np.array([int(name) * unit_ns for name in names], np.int64), "file names, since 1970"
    try:
        return np.array([nanoseconds(name) for name in names], np.int64), "file names, seconds"
    except ValueError:
        return np.arange(len(names), dtype=np.int64) * _PERIOD_NS, "alphabetical at 10 Hz"
