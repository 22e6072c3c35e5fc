"""Mutated files of every kind: each is refused in one line that names it, or read, with a remark where numbers are odd.

`python tests/fuzz/worker.py KINDS COUNT SEED SCRATCH` repeats a part with another seed.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

WORKER = Path(__file__).with_name("worker.py")
SEED = 20  # kept: what failed once is read again by every run
TEXTS = [
    "tum",
    "euroc",
    "kitti poses",
    "kitti times, poses, calib",
    "wireless log",
    "radio table",
    "wsr",
    "pyfg",
    "g2o",
    "toro",
    "jrl",
    "dataset",
    "config",
    "words",
    "metadata",
    "candidates",
    "run folder",
    "report",
    "imu table",
    "gnss table",
    "pcd ascii",
    "ply ascii",
]
BINARIES = [
    "pcd binary",
    "pcd compressed",
    "ply binary",
    "bin",
    "ros1",
    "ros1 bz2",
    "ros1 lz4",
    "mcap",
    "mcap zstd",
    "mcap lz4",
    "sqlite3",
    "odometry topic",
    "wireless topics",
    "g2o gz",
    "g2o xz",
    "jrl cbor",
    "odometry entry",
    "descriptor entry",
    "registration entry",
]


def fuzz(kinds: list[str], count: int, seed: int, scratch: Path) -> None:
    done = subprocess.run(
        [sys.executable, WORKER, ";".join(kinds), str(count), str(seed), scratch],
        capture_output=True, text=True, timeout=1800, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert [one["kind"] for one in found] == kinds
    assert [one["wrong"] for one in found if one["wrong"]] == []
    for one in found:
        assert sum(one["counts"].values()) == count
        assert one["counts"].get("refused", 0) + one["counts"].get("read with a remark", 0) > 0
        assert one["peak_bytes"] < 2e9


def test_a_few_of_each(tmp_path: Path) -> None:
    fuzz(TEXTS + BINARIES, 10, SEED, tmp_path)


@pytest.mark.slow
@pytest.mark.hours
@pytest.mark.parametrize("kind", TEXTS)
def test_texts(kind: str, tmp_path: Path) -> None:
    fuzz([kind], 1000, SEED, tmp_path)


@pytest.mark.slow
@pytest.mark.hours
@pytest.mark.parametrize("kind", BINARIES)
def test_binaries(kind: str, tmp_path: Path) -> None:
    fuzz([kind], 200, SEED, tmp_path)
