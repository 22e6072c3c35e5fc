"""What the user names, opened: recordings and worlds alike."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.data.dataset_file import write_dataset
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.types import Scan, Trajectory, WirelessLog, WirelessMeasurement

STAMPS_NS = 10**9 + np.arange(4) * 10**8
POSES = np.tile(np.eye(4), (4, 1, 1))
LOG = WirelessLog((WirelessMeasurement(10**9, "alpha", "beta", 5.0, 0.5),))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    points = np.random.default_rng(0).normal(0, 9, (50, 3))
    for robot in ("alpha", "beta"):
        poses = POSES if robot == "alpha" else None
        write_kitti_folder(tmp_path / robot, [Scan(int(t), points) for t in STAMPS_NS], T_world_lidar=poses)
    write_tum(tmp_path / "beta.tum", Trajectory("beta", STAMPS_NS, POSES))
    write_wireless_log(tmp_path / "radio.jsonl", LOG)
    return tmp_path


def test_recordings_with_their_truth_radio_and_odometry(folder: Path) -> None:
    robots = {
        "alpha": RobotRecording(folder / "alpha"),
        "beta": RobotRecording(folder / "beta", odometry=folder / "beta.tum"),
    }
    write_dataset(folder / "dataset.yaml", robots, [RadioSource(path=folder / "radio.jsonl")])
    inputs = open_inputs([str(folder)], limit=3)
    assert [(r.robot, len(r.scans), r.odometry is None) for r in inputs.robots] == [
        ("alpha", 3, True), ("beta", 3, False)
    ]  # fmt: skip
    assert (list(inputs.ground_truth), inputs.wireless) == (["alpha"], LOG)


def test_the_identity_tells_whatever_changes_scans_or_odometry(folder: Path) -> None:
    words = [f"alpha={folder}/alpha"]

    def identity(robots: RobotRecording | None = None, **changes: int) -> str:
        if robots is None:
            return json.dumps(open_inputs(words, **changes).robots[0].identity)
        write_dataset(folder / "dataset.yaml", {"alpha": robots})
        return json.dumps(open_inputs([str(folder)]).robots[0].identity)

    same = identity()
    assert identity() == same
    others = [
        identity(limit=2),
        identity(salvage=True),
        identity(RobotRecording(folder / "beta")),
        identity(RobotRecording(folder / "alpha", time_offset=0.5)),
        identity(RobotRecording(folder / "alpha", odometry=folder / "beta.tum")),
    ]
    assert len({same, *others}) == 6
    (folder / "alpha" / "velodyne" / "000000.bin").write_bytes(b"")
    assert identity() != same


def test_bad_words_are_refused_before_any_work(folder: Path) -> None:
    with pytest.raises(ConfigError, match="a scenario stands alone"):
        open_inputs(["scenario:city", f"alpha={folder}/alpha"])
    with pytest.raises(InputError, match="mentions the robot 'beta'"):
        open_inputs([f"alpha={folder}/alpha"], wireless=[str(folder / "radio.jsonl")])
