"""Mutated recordings: each is refused in one line that names it, or read; nothing crashes, hangs or fills memory."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline.data.dataset_writer import write_ros1_bag, write_ros2_bag

from .clouds.test_pcd import BAG_TO_PCD, columns_of, pcd_bytes
from .clouds.test_ply import ply_bytes
from .clouds.test_record_size import records
from .conftest import make_scans
from .mcap_bytes import mcap_bytes
from .test_odd_bags import clouds

KINDS = ["ros1", "mcap", "unindexed mcap", "sqlite3", "pcd ascii", "pcd binary", "pcd binary_compressed"]
KINDS += ["ply ascii", "ply binary_little_endian", "bin"]


def original(kind: str, folder: Path) -> Path:
    scans = make_scans(8, 400)
    if kind == "ros1":
        write_ros1_bag(folder / "a.bag", scans)
        return folder / "a.bag"
    if kind in {"mcap", "sqlite3"}:
        write_ros2_bag(folder / "a", scans, storage="mcap" if kind == "mcap" else "sqlite3")
        return next(file for file in (folder / "a").iterdir() if file.suffix in {".mcap", ".db3"})
    name, _, how = kind.partition(" ")
    if kind == "unindexed mcap":
        path, content = folder / "a.mcap", mcap_bytes([clouds(scans)])
    elif name == "pcd":
        path, content = folder / "000000.pcd", pcd_bytes(BAG_TO_PCD, columns_of(BAG_TO_PCD, 400), how)
    elif name == "ply":
        path, content = folder / "000000.ply", ply_bytes(how, 400)[0]
    else:
        path, content = folder / "000000.bin", records("kitti", 3000).tobytes()
    path.write_bytes(content)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", [0])
def test_mutated_recordings(tmp_path: Path, kind: str, seed: int) -> None:
    (tmp_path / "scratch").mkdir()
    path = original(kind, tmp_path)
    script = Path(__file__).with_name("mutation.py")
    done = subprocess.run(
        [sys.executable, script, path, tmp_path / "scratch", str(seed)],
        capture_output=True, text=True, timeout=900, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    assert "refused" in done.stdout


def test_the_originals_are_read(tmp_path: Path) -> None:
    from wiclosure.pipeline.sources.open import open_source

    for kind in KINDS:
        (tmp_path / kind).mkdir()
        path = original(kind, tmp_path / kind)
        source = open_source(path if path.suffix in {".bag", ".mcap", ".db3"} else path.parent)
        assert len(list(source)) == (8 if path.suffix in {".bag", ".mcap", ".db3"} else 1)
        assert all(np.isfinite(scan.points).all() for scan in source)
