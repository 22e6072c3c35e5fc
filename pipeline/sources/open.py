"""Finds the loader for a recording."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.radio.radio_units import METRES, LengthUnit
from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.runtime.paths import is_endless
from wiclosure.pipeline.sources.bag_files import bag_kind
from wiclosure.pipeline.sources.folder import FolderSource, is_cloud_folder
from wiclosure.pipeline.sources.kitti import KittiSource, is_kitti_folder
from wiclosure.pipeline.sources.rosbag import RosbagSource
from wiclosure.types import Scan

_ENOUGH = 100  # points, that their distance says something
_FARTHEST_M = 250.0  # of half of the points
_OF_A_MAP_M = 2e5  # 200 m in millimetres


@dataclass(frozen=True, slots=True)
class Loader:
    """One kind of recording.

    Args:
        recognises: whether a path is such a recording; looks at names and first bytes only.
        open: opens it; topic and salvage only mean something for bags, layout for folders of `.bin` files.
        what: what it reads, for the user.
    """

    recognises: Callable[[Path], bool]
    open: Callable[[Path, str | None, bool, str | None], ScanSource]
    what: str


LOADERS: Mapping[str, Loader] = {
    "rosbag": Loader(
        lambda path: bag_kind(path) is not None,
        lambda path, topic, salvage, layout: RosbagSource(path, topic, salvage=salvage),
        "ROS 1 bag (.bag), ROS 2 bag (folder, .mcap, .db3)",
    ),
    "kitti": Loader(
        is_kitti_folder,
        lambda path, topic, salvage, layout: KittiSource(path),
        "KITTI odometry sequence (velodyne/, times.txt) or raw drive (velodyne_points/)",
    ),
    "folder": Loader(
        is_cloud_folder,
        lambda path, topic, salvage, layout: FolderSource(path, layout),
        "folder of .pcd, .ply, .bin, .las or .laz files",
    ),
}


def guess_loader(path: Path) -> str:
    """Name of the loader that recognises the recording.

    Raises:
        InputError: the path does not exist, cannot be read, or is no recording that any loader knows.
    """
    try:
        if not path.exists():
            raise InputError(f"recording {path} does not exist; check the path")
        if is_endless(path):
            raise InputError(f"recording {path} is neither a file nor a folder; name one")
        found = next((name for name, loader in LOADERS.items() if loader.recognises(path)), None)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; check its permissions") from error
    if found is None:
        supported = "; ".join(loader.what for loader in LOADERS.values())
        inner = [
            folder.name for folder in _folders(path) if any(loader.recognises(folder) for loader in LOADERS.values())
        ]
        hint = f"; name one of the recordings in it: {', '.join(inner[:8])}" if inner else ""
        raise InputError(f"{path} is not a recording that can be read{hint}; supported: {supported}")
    return found


def _folders(path: Path) -> list[Path]:
    return sorted(inner for inner in path.iterdir() if inner.is_dir()) if path.is_dir() else []


def open_source(
    path: Path | str,
    *,
    topic: str | None = None,
    limit: int | None = None,
    salvage: bool = False,
    time_offset: float = 0.0,
    layout: str | None = None,
    unit: LengthUnit | None = None,
) -> ScanSource:
    """Opens a recording of one LiDAR; the kind of recording is guessed.

    Args:
        path: file or folder.
        topic: PointCloud2 topic of a bag; None takes the only one.
        limit: read at most so many scans.
        salvage: use what can be read of a damaged bag.
        time_offset: seconds to add to every stamp.
        layout: fields of the records in a folder's `.bin` files; None: KITTI's.
        unit: of the coordinates; None: metres, which is looked at while it is read.

    Raises:
        InputError: the recording cannot be used; names it and the way out.
        ConfigError: limit is not positive.
    """
    path = Path(path)
    if limit is not None and limit < 1:
        raise ConfigError(f"the number of scans is {limit}; it must be at least 1")
    kind = guess_loader(path)
    if topic is not None and kind != "rosbag":
        raise InputError(f"{path} is no bag and has no topic {topic}; take the topic away, or name the bag")
    source = LOADERS[kind].open(path, topic, salvage, layout)
    return _Excerpt(source, path, limit, round(time_offset * 1e9), unit)


class _Excerpt:
    """The first scans of a source, with their clock set right, in metres."""

    def __init__(
        self, source: ScanSource, path: Path, limit: int | None, offset_ns: int, unit: LengthUnit | None
    ) -> None:
        self._source = source
        self._path = path
        self._limit = limit
        self._offset_ns = offset_ns
        self._unit = unit

    @property
    def description(self) -> str:
        """One line for the user."""
        first = f", first {len(self)}" if self._limit is not None else ""
        shifted = f", stamps {self._offset_ns * 1e-9:+g} s" if self._offset_ns else ""
        return f"{self._source.description}{first}{shifted}"

    def __len__(self) -> int:
        return len(self._source) if self._limit is None else min(self._limit, len(self._source))

    def __iter__(self) -> Iterator[Scan]:
        looked_at = self._unit is not None
        for scan in islice(self._source, self._limit):
            if not looked_at and len(scan.points) >= _ENOUGH:
                _refuse_other_units(self._path, scan)
                looked_at = True
            if self._offset_ns or self._unit not in (None, "m"):
                points = scan.points * METRES[self._unit or "m"]
                yield replace(scan, stamp_ns=scan.stamp_ns + self._offset_ns, points=points)
            else:
                yield scan


def _refuse_other_units(path: Path, scan: Scan) -> None:
    """Refuses coordinates that are no metres from a sensor, by the first scan.

    Raises:
        InputError: half of its points lie farther than any LiDAR sees all around.
    """
    typical = float(np.median(np.linalg.norm(scan.points, axis=1)))
    if typical < _FARTHEST_M:
        return
    if typical > _OF_A_MAP_M:
        raise InputError(
            f"{path}: half of the points of its first scan lie beyond {typical:.3g}: these are coordinates of a map;"
            " scans must be in the sensor's own axes"
        )
    raise InputError(
        f"{path}: half of the points of its first scan lie beyond {typical:.0f} m, where no LiDAR sees: in mm it is"
        f" {typical / 1e3:.2g} m, in cm {typical / 1e2:.2g} m; add scan_unit: mm, or cm, to this robot in the"
        " dataset.yaml (or m, where it is right)"
    )
