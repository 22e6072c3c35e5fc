from __future__ import annotations

import time
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.runtime.reading_ahead import read_ahead
from wiclosure.types import Scan


def scan(number: int, points: int) -> Scan:
    xyz = np.random.default_rng(number).normal(size=(points, 3)).astype(np.float32).astype(float)
    times, intensity = np.linspace(0, 0.1, points), np.ones(points, np.float32)
    return Scan(10**9 + number * 10**8, xyz, times, intensity)


def source(path: Path) -> ScanSource:
    (robot,) = open_inputs([f"alpha={path}"]).robots
    return robot.scans


def bag(folder: Path, *sizes: int) -> Path:
    write_ros1_bag(folder / "alpha.bag", [scan(number, points) for number, points in enumerate(sizes)])
    return folder / "alpha.bag"


def assert_same(one: Scan, other: Scan) -> None:
    assert one.stamp_ns == other.stamp_ns
    for array, expected in ((one.points, other.points), (one.times, other.times), (one.intensity, other.intensity)):
        assert (array is None) == (expected is None)
        if array is not None and expected is not None:
            np.testing.assert_array_equal(array, expected)
            assert array.dtype == expected.dtype


@pytest.mark.parametrize("kind", ["bag with times", "folder without"])
def test_scans_arrive_as_they_are_and_in_order(tmp_path: Path, kind: str) -> None:
    sizes = 1, 100_000, 0, 7, 50_000
    if kind == "bag with times":
        path = bag(tmp_path, *sizes)
    else:
        path = tmp_path / "alpha"
        write_kitti_folder(path, [scan(number, points) for number, points in enumerate(sizes)])
    with read_ahead(source(path)) as scans:
        arrived = list(scans)
    expected = list(source(path))
    assert len(expected) == len(sizes)
    for one, other in zip(arrived, expected, strict=True):
        assert_same(one, other)


def test_what_the_source_complains_of_is_said_here_after_what_it_read(tmp_path: Path) -> None:
    path = tmp_path / "alpha"
    write_kitti_folder(path, [scan(number, 100) for number in range(3)])
    whole = source(path)
    (path / "velodyne" / "000002.bin").write_bytes(b"seven b")
    arrived = []
    with pytest.raises(InputError, match=r"000002\.bin"), read_ahead(whole) as scans:
        for one in scans:
            arrived.append(one)
    assert len(arrived) == 2
    assert active_children() == []


def test_a_reader_that_is_killed_is_named(tmp_path: Path) -> None:
    path = bag(tmp_path, *[100_000] * 20)
    with pytest.raises(InputError, match=r"alpha\.bag.*died"), read_ahead(source(path)) as scans:
        next(scans)
        (reader,) = active_children()
        reader.kill()
        list(scans)


def test_leaving_early_leaves_no_process_behind(tmp_path: Path) -> None:
    with read_ahead(source(bag(tmp_path, *[100_000] * 20))) as scans:
        next(scans)
        assert len(active_children()) == 1
    assert active_children() == []


def test_the_next_scan_is_read_while_one_is_worked_on(tmp_path: Path) -> None:
    """Removed from the disk meanwhile, it arrives nevertheless; the one after it does not."""
    path = tmp_path / "alpha"
    write_kitti_folder(path, [scan(number, 100_000) for number in range(20)])
    with pytest.raises(InputError, match=r"\.bin"), read_ahead(source(path)) as scans:
        next(scans)
        time.sleep(1.0)
        for file in sorted((path / "velodyne").glob("*.bin"))[1:]:
            file.unlink()
        np.testing.assert_array_equal(next(scans).points, scan(1, 100_000).points)
        list(scans)
