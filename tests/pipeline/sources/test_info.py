from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag
from wiclosure.pipeline.sources.info import FieldInfo, recording_info
from wiclosure.types import Scan


def test_the_first_cloud_is_described_as_it_was_recorded(bags: dict[str, Path]) -> None:
    (topic,) = recording_info(bags["ros1"]).topics
    cloud = topic.first_cloud
    assert cloud is not None
    assert (cloud.height, cloud.width, cloud.point_step, cloud.frame_id) == (1, 300, 20, "lidar")
    assert cloud.fields == tuple(
        FieldInfo(name, "f4", 4 * k) for k, name in enumerate(("x", "y", "z", "intensity", "time"))
    )


def test_points_that_are_no_returns_are_not_counted(tmp_path: Path) -> None:
    points = np.ones((10, 3))
    points[[2, 5]] = 0.0
    write_ros1_bag(tmp_path / "a.bag", [Scan(10**18, points)])
    (topic,) = recording_info(tmp_path / "a.bag").topics
    assert topic.first_cloud is not None
    assert (topic.first_cloud.width, topic.first_cloud.returns, topic.first_cloud.times) == (10, 8, None)


def test_a_kitti_folder_has_scans_and_what_lies_beside_them(tmp_path: Path, scans: list[Scan]) -> None:
    write_kitti_folder(tmp_path / "kitti", scans)
    (tmp_path / "kitti" / "poses.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n" * 6)
    info = recording_info(tmp_path / "kitti")
    assert (info.kind, info.count, info.topics) == ("KITTI folder", 6, ())
    assert info.duration_s == pytest.approx(0.5)
    assert info.bytes_on_disk == 6 * 300 * 4 * 4  # x, y, z and intensity as float32
    assert "poses.txt" in info.notes[0]


def test_a_salvaged_bag_says_so(bags: dict[str, Path]) -> None:
    info = recording_info(bags["mcap"], salvage=True)
    assert info.notes == ("Salvaged: only messages that are whole are counted.",)
    assert info.count == 6


def test_what_is_no_recording_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="nowhere"):
        recording_info(tmp_path / "nowhere")
