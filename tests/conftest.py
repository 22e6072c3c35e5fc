"""Fixtures that all tests share."""

from __future__ import annotations

import os
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does, before numpy is there

import numpy as np
import pytest
from hypothesis import settings

from wiclosure.types import Scan

# How long an example takes says more of the machine than of the code.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")

REPOSITORY = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of recorded data: `WICLOSURE_DATA`, or `../shared/data` beside the repository."""
    folder = Path(os.environ.get("WICLOSURE_DATA", REPOSITORY.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"recorded data not found at {folder}; set WICLOSURE_DATA")
    return folder


class RecordedScans:
    """A recording packed in one `scans.npz`, one scan at a time; `poses (N, 4, 4)` in the LiDAR's frame."""

    def __init__(self, path: Path) -> None:
        with np.load(path) as pack:
            self._xyz, self._offsets, self._scale = pack["xyz"], pack["offsets"], float(pack["scale"])
            self.poses = pack["poses"]
            self.stamps_ns = np.rint(pack["stamps"] * 1e9).astype(np.int64)

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def __getitem__(self, index: int) -> Scan:
        if not 0 <= index < len(self):
            raise IndexError(index)
        points = self._xyz[:, self._offsets[index] : self._offsets[index + 1]].T * self._scale
        return Scan(int(self.stamps_ns[index]), np.ascontiguousarray(points))


def _recorded(data_dir: Path, name: str) -> RecordedScans:
    path = data_dir / name / "scans.npz"
    if not path.is_file():
        pytest.skip(f"{path} not found; set WICLOSURE_DATA")
    return RecordedScans(path)


@pytest.fixture(scope="session")
def kitti_drive(data_dir: Path) -> RecordedScans:
    """KITTI raw drive 2011_09_26_0005: 154 scans of an HDL-64, 71.5 m with an S-turn."""
    return _recorded(data_dir, "kitti_raw_0926_0005")


@pytest.fixture(scope="session")
def indoor_loop(data_dir: Path) -> RecordedScans:
    """177 scans of an indoor LiDAR at 2 Hz, 74.5 m with revisits; poses from SLAM."""
    return _recorded(data_dir, "indoor_loop")
