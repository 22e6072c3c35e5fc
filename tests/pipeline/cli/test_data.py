"""`wiclosure split` and `wiclosure info`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.data.dataset import load_dataset
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag
from wiclosure.types import Scan

Call = Callable[..., tuple[int, str, str]]
SCANS = [Scan(10**9 + k * 10**8, np.full((4, 3), k + 1.0)) for k in range(40)]


@pytest.fixture
def drive(tmp_path: Path) -> Path:
    """200 m straight on: the robots hear each other."""
    along = np.arange(40) * 5.0
    poses = se3.from_yaw(0 * along, np.stack([along, 0 * along, 0 * along], axis=1))
    write_kitti_folder(tmp_path / "drive", SCANS, T_world_lidar=poses)
    return tmp_path / "drive"


def test_split_makes_a_team_with_radio(wiclosure: Call, drive: Path, tmp_path: Path) -> None:
    code, out, err = wiclosure("split", drive, "--robots", "2", "--out", tmp_path / "team")
    assert (code, err) == (0, "")
    assert "data set of 2 robots" in out
    team = load_dataset([str(tmp_path / "team")])
    assert [len(team.scans(robot)) for robot in team.robots] == [20, 20]
    assert len(team.wireless_log().measurements) > 0
    assert wiclosure("split", drive, "--robots", "2", "--out", tmp_path / "silent", "--no-radio")[0] == 0
    assert load_dataset([str(tmp_path / "silent")]).wireless == ()


def test_the_radio_follows_its_seed(wiclosure: Call, drive: Path, tmp_path: Path) -> None:
    logs = []
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        assert wiclosure("split", drive, "--robots", "2", "--seed", seed, "--out", tmp_path / name)[0] == 0
        logs.append((tmp_path / name / "wireless.jsonl").read_text())
    assert logs[0] == logs[1] != logs[2]


def test_info_as_table_and_as_json(wiclosure: Call, tmp_path: Path) -> None:
    write_ros1_bag(tmp_path / "a.bag", SCANS)
    code, out, _ = wiclosure("info", tmp_path / "a.bag")
    assert code == 0
    assert "/points" in out
    assert "40 x sensor_msgs/msg/PointCloud2" in out
    code, out, _ = wiclosure("info", tmp_path / "a.bag", "--json")
    found = json.loads(out)
    assert (found["topics"][0]["name"], found["topics"][0]["count"], found["start_ns"]) == ("/points", 40, 10**9)


def test_what_is_no_recording_is_one_line(wiclosure: Call, tmp_path: Path) -> None:
    code, out, err = wiclosure("info", tmp_path / "gone.bag")
    assert (code, out, err.count("\n")) == (1, "", 1)
    assert "gone.bag" in err
