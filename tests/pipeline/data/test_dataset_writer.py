"""Recordings as they are written; that they are read alike is tested with the sources."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import OutputError
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag, write_ros2_bag
from wiclosure.pipeline.sources.info import recording_info
from wiclosure.types import Heading, Scan, WirelessLog, WirelessMeasurement

SCANS = [Scan(10**9 + k * 10**8, np.full((4, 3), k + 1.0), intensity=np.full(4, 0.5)) for k in range(3)]
LOG = WirelessLog((WirelessMeasurement(10**9 + 5, "alpha", "beta", 5.0, 0.5),), (Heading(10**9, "alpha", 0.5, 0.1),))
WRITERS: list[Callable[..., None]] = [
    write_ros1_bag,
    write_ros2_bag,
    lambda path, scans, **more: write_ros2_bag(path, scans, storage="sqlite3", **more),
]
IDS = ["ros1", "mcap", "sqlite3"]


@pytest.mark.parametrize("write", WRITERS, ids=IDS)
def test_topics_of_a_bag(tmp_path: Path, write: Callable[..., None]) -> None:
    path = tmp_path / ("a.bag" if write is write_ros1_bag else "a")
    write(path, SCANS, wireless=LOG)
    found = recording_info(path)
    assert {topic.name: topic.count for topic in found.topics} == {"/points": 3, "/wireless": 1, "/heading": 1}
    assert found.start_ns == 10**9


@pytest.mark.parametrize("write", [*WRITERS, write_kitti_folder], ids=[*IDS, "kitti"])
def test_a_recording_appears_whole_or_not_at_all(tmp_path: Path, write: Callable[..., None]) -> None:
    def broken() -> Iterator[Scan]:
        yield SCANS[0]
        raise RuntimeError("the sensor fell off")

    with pytest.raises(RuntimeError, match="fell off"):
        write(tmp_path / "a.bag", broken())
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "a.bag").touch()
    with pytest.raises(OutputError, match=r"a\.bag"):
        write(tmp_path / "a.bag", SCANS)
    assert [path.name for path in tmp_path.iterdir()] == ["a.bag"]


@pytest.mark.parametrize("stamp_ns", [-1, 2**31 * 10**9])
def test_a_stamp_that_ros_cannot_express_is_refused(tmp_path: Path, stamp_ns: int) -> None:
    with pytest.raises(OutputError, match="does not fit a ROS time"):
        write_ros1_bag(tmp_path / "a.bag", [Scan(stamp_ns, np.ones((2, 3)))])


def test_a_kitti_folder(tmp_path: Path) -> None:
    poses = np.tile(np.eye(4), (3, 1, 1))
    write_kitti_folder(tmp_path / "08", SCANS, T_world_lidar=poses)
    rows = np.fromfile(tmp_path / "08" / "velodyne" / "000001.bin", "<f4").reshape(-1, 4)
    np.testing.assert_array_equal(rows, np.tile([2.0, 2.0, 2.0, 0.5], (4, 1)))
    assert [float(t) for t in (tmp_path / "08" / "times.txt").read_text().split()] == [1.0, 1.1, 1.2]
    np.testing.assert_array_equal(np.loadtxt(tmp_path / "08" / "poses.txt"), poses[:, :3].reshape(3, 12))
    with pytest.raises(OutputError, match="2 poses for 3 scans"):
        write_kitti_folder(tmp_path / "09", SCANS, T_world_lidar=poses[:2])
