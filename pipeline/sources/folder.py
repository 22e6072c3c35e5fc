"""A folder of single clouds: PCD, PLY, BIN, LAS."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.pipeline.runtime.paths import is_endless
from wiclosure.pipeline.sources.clouds.bin import KITTI, check_layout, likely_layouts, read_bin
from wiclosure.pipeline.sources.clouds.columns import CloudColumns, CloudReader
from wiclosure.pipeline.sources.clouds.file_stamps import FileStamps, natural, stamps_of_names
from wiclosure.pipeline.sources.clouds.las import read_las
from wiclosure.pipeline.sources.clouds.pcd import read_pcd
from wiclosure.pipeline.sources.clouds.ply import read_ply
from wiclosure.pipeline.sources.clouds.times_file import times_beside
from wiclosure.pipeline.sources.messages.timed_scans import TimedScans
from wiclosure.types import Scan

logger = logging.getLogger(__name__)

_SHORTEST_PERIOD_S, _LONGEST_PERIOD_S = 1e-3, 60.0  # between scans, in the middle; a LiDAR turns at 2 to 50 Hz

CLOUD_READERS: Mapping[str, CloudReader] = {
    ".bin": read_bin,
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".las": read_las,
    ".laz": read_las,
}


def is_cloud_folder(path: Path) -> bool:
    """Whether the folder holds cloud files."""
    return path.is_dir() and any(map(_is_cloud, path.iterdir()))


def _is_cloud(file: Path) -> bool:
    """By its ending; hidden files are what other systems leave beside."""
    return file.suffix.lower() in CLOUD_READERS and not file.name.startswith(".") and not is_endless(file)


class FolderSource:
    """The cloud files of a folder, in order of time.

    Stamps come from `times.txt` or `timestamps.txt` beside the clouds, a line for each in natural order, or from the
    files' names (see `file_stamps`).

    Args:
        path: the folder.
        layout: fields of the records in `.bin` files (see `clouds.bin.LAYOUTS`); None: KITTI's.

    Raises:
        InputError: no cloud files, several kinds of them, or `.bin` files whose records are clearly of another layout.
    """

    def __init__(self, path: Path, layout: str | None = None) -> None:
        self.path = path
        files = [file for file in path.iterdir() if _is_cloud(file)]
        files.sort(key=lambda file: natural(file.name))
        suffixes = sorted({file.suffix.lower() for file in files})
        if len(suffixes) != 1:
            found = f"holds {' and '.join(suffixes)} files" if suffixes else "holds no cloud files"
            raise InputError(f"{path} {found}; expected one kind of {', '.join(CLOUD_READERS)}")
        self._suffix, self._layout = suffixes[0], layout
        if self._suffix == ".bin":
            check_layout(_largest(files[:20]), layout or KITTI)
        found_stamps = _stamps(path, files)
        self.stamps_from, self.made_up = found_stamps.how, found_stamps.made_up
        order = np.argsort(found_stamps.stamps_ns, kind="stable")
        self.scan_files = [files[index] for index in order]
        self.stamps_ns = found_stamps.stamps_ns[order]

    @property
    def description(self) -> str:
        """One line for the user."""
        return f"folder {self.path}, {len(self.scan_files)} {self._suffix} scans, stamps: {self.stamps_from}"

    def __len__(self) -> int:
        """Number of scan files."""
        return len(self.scan_files)

    def __iter__(self) -> Iterator[Scan]:
        """The scans in order of time."""
        if self.made_up:
            logger.warning(
                "%s: nothing tells when the clouds were taken: their stamps are made up (%s); write times.txt beside"
                " them, a time in seconds for each", self.path, self.stamps_from,
            )  # fmt: skip
        self._say_odd_times()
        read, scans = CLOUD_READERS[self._suffix], TimedScans(str(self.path), self._period_s)
        if self._suffix == ".bin" and self._layout is not None:
            read = partial(read_bin, layout=self._layout)
        is_said = False
        for file, stamp_ns in zip(self.scan_files, self.stamps_ns.tolist(), strict=True):
            cloud = read(file)
            is_said = is_said or _say_untimed(file, cloud)
            try:
                scan = scans(stamp_ns, cloud.points, cloud.times, cloud.intensity)
            except InputError as error:
                raise InputError(f"{file}: {error}") from error
            yield scan

    def _say_odd_times(self) -> None:
        """Warns of stamps that no LiDAR has: most often their unit is not what it was taken for."""
        if (same := len(self.stamps_ns) - len(np.unique(self.stamps_ns))) > 0:
            logger.warning("%s: %d stamps repeat others (%s)", self.path, same, self.stamps_from)
        elif (period_s := self._period_s) is not None and not _SHORTEST_PERIOD_S <= period_s <= _LONGEST_PERIOD_S:
            logger.warning(
                "%s: scans would come every %g s by their stamps (%s); are those in another unit? write times.txt"
                " beside the clouds, a time in seconds for each", self.path, period_s, self.stamps_from,
            )  # fmt: skip

    @property
    def _period_s(self) -> float | None:
        return float(np.median(np.diff(self.stamps_ns))) * 1e-9 if len(self.stamps_ns) > 1 else None


def _stamps(path: Path, files: list[Path]) -> FileStamps:
    if (beside := times_beside(path, len(files))) is not None:
        return FileStamps(beside[0], str(beside[1]))
    return stamps_of_names([_stem(file) for file in files])


def _say_untimed(file: Path, cloud: CloudColumns) -> bool:
    """Warns where a field looks like the points' times and tells nothing; whether there are points to tell it by."""
    if len(cloud.points) and cloud.time_field is not None:
        if cloud.times is None:
            logger.warning(
                "%s: field %s looks like per-point times but is not used: the scans are not deskewed; name it time"
                " where it is one", file, cloud.time_field,
            )  # fmt: skip
        elif cloud.times.min() == cloud.times.max():
            logger.warning(
                "%s: field %s is the same for all points: the scans are not deskewed", file, cloud.time_field
            )
    return len(cloud.points) > 0


def _stem(file: Path) -> str:
    """The name without its suffixes; nuScenes' have two (`.pcd.bin`)."""
    while file.suffix.lower() in CLOUD_READERS:
        file = file.with_suffix("")
    return file.name


def layouts_of(path: Path) -> list[str]:
    """Names of the layouts that the `.bin` files of a folder may have.

    Raises:
        InputError: a file cannot be read.
    """
    files = sorted(path.glob("*.bin"))[:20] if path.is_dir() else []
    return likely_layouts(_largest(files)) if files else []


def _largest(files: list[Path]) -> Path:
    return max(files, key=lambda file: file.stat().st_size)
