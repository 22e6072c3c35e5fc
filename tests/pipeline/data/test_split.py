"""Splitting a KITTI drive: parts, clocks, ground truth, all or nothing."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.errors import ConfigError, InputError, OutputError
from wiclosure.pipeline.data.dataset import Dataset, load_dataset
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.data.split import contiguous_parts, find_sequence, split_kitti
from wiclosure.types import FloatArray, Heading, Scan, WirelessLog

COUNT = 31
STAMPS_NS = (10**18 + np.arange(COUNT) * 103_700_001).astype(np.int64)


def scan(number: int) -> Scan:
    return Scan(int(STAMPS_NS[number]), np.full((3, 3), number + 1.0))


def poses() -> FloatArray:
    x = np.arange(COUNT) * 1.5
    return se3.from_yaw(x / 20, np.stack([x, np.sin(x / 9), 0 * x], axis=1))


@pytest.fixture
def kitti(tmp_path: Path) -> Path:
    write_kitti_folder(tmp_path / "kitti" / "sequences" / "08", map(scan, range(COUNT)), T_world_lidar=poses())
    write_kitti_folder(tmp_path / "kitti" / "sequences" / "03", map(scan, range(5)))
    return tmp_path / "kitti"


def test_three_robots_set_out_together(kitti: Path, tmp_path: Path) -> None:
    dataset = split_kitti(find_sequence(kitti, "08"), 3, tmp_path / "out")
    assert list(dataset.robots) == ["alpha", "beta", "gamma"]
    numbers: list[int] = []
    for robot in dataset.robots:
        read = list(dataset.scans(robot))
        mine = [round(s.points[0, 0]) - 1 for s in read]
        assert read[0].stamp_ns == STAMPS_NS[0]
        np.testing.assert_array_equal(np.diff([s.stamp_ns for s in read]), np.diff(STAMPS_NS[mine]))
        truth = dataset.ground_truth(robot)
        assert truth is not None
        np.testing.assert_array_equal(truth.stamps_ns, [s.stamp_ns for s in read])
        np.testing.assert_allclose(truth.poses, poses()[mine], atol=1e-12)
        numbers += mine
    assert numbers == list(range(COUNT))
    record = json.loads((tmp_path / "out" / "split.json").read_text())
    assert record["robots"]["beta"]["time_shift_ns"] == STAMPS_NS[0] - STAMPS_NS[record["robots"]["beta"]["first"]]


def test_the_data_set_can_be_moved(kitti: Path, tmp_path: Path) -> None:
    split_kitti(find_sequence(kitti / "sequences" / "08", None), 2, tmp_path / "out")
    (tmp_path / "out").rename(tmp_path / "moved")
    assert len(load_dataset([str(tmp_path / "moved")]).scans("beta")) in {15, 16}


@given(count=st.integers(20, 5000), robots=st.integers(2, 10), overlap=st.floats(0, 0.9))
@example(count=110, robots=4, overlap=2.220446049250313e-16)  # rounds up where one begins, down where one ends
def test_parts_cover_the_drive_and_overlap_as_asked(count: int, robots: int, overlap: float) -> None:
    parts = list(contiguous_parts(np.arange(count) * 10, robots, overlap).values())
    assert parts[0].first == 0
    assert parts[-1].last == count - 1
    lengths = [part.last - part.first + 1 for part in parts]
    assert max(lengths) - min(lengths) <= 2
    for a, b in pairwise(parts):
        assert a.first <= b.first <= a.last + 1
        assert abs((a.last - b.first + 1) - overlap * lengths[0]) <= 2


def test_a_wireless_log_made_from_the_ground_truth(kitti: Path, tmp_path: Path) -> None:
    def heard(dataset: Dataset) -> WirelessLog:
        truth = dataset.ground_truth("beta")
        assert truth is not None
        return WirelessLog((), (Heading(int(truth.stamps_ns[0]), "beta", float(se3.yaw(truth.poses)[0]), 0.1),))

    dataset = split_kitti(find_sequence(kitti, "08"), 2, tmp_path / "out", heard=heard)
    assert [h.robot for h in dataset.wireless_log().headings] == ["beta"]
    assert [source.path for source in dataset.wireless] == [tmp_path / "out" / "wireless.jsonl"]


def test_without_poses_there_is_no_ground_truth(kitti: Path, tmp_path: Path) -> None:
    def never(dataset: Dataset) -> WirelessLog:
        raise AssertionError("radio is simulated from the ground truth")

    dataset = split_kitti(find_sequence(kitti, "03"), 2, tmp_path / "out", heard=never)
    assert dataset.ground_truth("alpha") is None
    assert dataset.wireless == ()


def test_what_cannot_be_split(kitti: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    with pytest.raises(InputError, match="no KITTI sequence '09'; it has 03, 08"):
        split_kitti(find_sequence(kitti, "09"), 2, out)
    with pytest.raises(InputError, match="too few for 3 robots"):
        split_kitti(find_sequence(kitti, "03"), 3, out)
    with pytest.raises(ConfigError, match="--robots is 1"):
        split_kitti(find_sequence(kitti, "08"), 1, out)
    with pytest.raises(ConfigError, match="--overlap is 1"):
        split_kitti(find_sequence(kitti, "08"), 2, out, overlap=1.0)

    def fails(dataset: Dataset) -> WirelessLog:
        raise InputError("no radio today")

    with pytest.raises(InputError, match="no radio"):
        split_kitti(find_sequence(kitti, "08"), 2, out, heard=fails)
    assert [path.name for path in tmp_path.iterdir()] == ["kitti"]
    out.mkdir()
    with pytest.raises(OutputError, match="exists already"):
        split_kitti(find_sequence(kitti, "08"), 2, out)
    assert len(split_kitti(find_sequence(kitti, "08"), 2, out, overwrite=True).robots) == 2
