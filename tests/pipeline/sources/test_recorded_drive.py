"""A recorded drive, written in every format and read back: the same points, to the bit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline.data.dataset import load_dataset
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag, write_ros2_bag
from wiclosure.pipeline.sources.open import open_source
from wiclosure.types import Scan

WRITERS: dict[str, Callable[[Path, Sequence[Scan]], None]] = {
    "ros1": write_ros1_bag,
    "mcap": partial(write_ros2_bag, storage="mcap"),
    "sqlite3": partial(write_ros2_bag, storage="sqlite3"),
    "kitti": write_kitti_folder,
}


@pytest.mark.parametrize("kind", WRITERS)
def test_points_are_identical(tmp_path: Path, kitti_drive: Sequence[Scan], kind: str) -> None:
    part = [kitti_drive[index] for index in range(0, 95, 24)]
    WRITERS[kind](tmp_path / "alpha", part)
    source = open_source(tmp_path / "alpha")
    count = 0
    for read, recorded in zip(source, part, strict=True):
        assert read.stamp_ns == recorded.stamp_ns
        assert len(read.points) > 100_000
        recorded32 = recorded.points.astype(np.float32)
        np.testing.assert_array_equal(read.points, recorded32[(recorded32 != 0).any(axis=1)])
        count += 1
    assert count == len(source) == 4


def test_two_robots_of_one_drive(tmp_path: Path, kitti_drive: Sequence[Scan]) -> None:
    """A: even scans, ROS 2 bag; B: odd scans, KITTI folder with poses, as `unpack.py` writes them."""
    poses = kitti_drive.poses  # type: ignore[attr-defined]  # the fixture's own type lives in conftest
    odd = list(range(61, 100, 10))
    write_ros2_bag(tmp_path / "a", (kitti_drive[index] for index in range(0, 40, 10)))
    write_kitti_folder(tmp_path / "b", (kitti_drive[index] for index in odd), T_world_lidar=poses[odd])
    dataset = load_dataset([f"a={tmp_path}/a", f"b={tmp_path}/b"])
    truth = dataset.ground_truth("b")
    assert truth is not None
    np.testing.assert_allclose(truth.poses, poses[odd], atol=1e-7)  # the recorded rotations are orthonormal to 1e-8
    assert truth.stamps_ns.tolist() == [scan.stamp_ns for scan in dataset.scans("b")]
    assert len(dataset.scans("a")) == 4
