"""A recorded drive as two robots, through the command line: a ROS 2 bag and a KITTI folder in, one map out."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.trajectories.tum import read_tum, write_tum
from wiclosure.frontends.config import KeyframeSettings, OdometrySettings
from wiclosure.frontends.front_end import OdometryRun
from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.data.dataset_file import write_dataset
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros2_bag
from wiclosure.pipeline.data.recording import RobotRecording
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import Trajectory

pytestmark = pytest.mark.slow

A = np.arange(0, 95, 2)
B = np.arange(61, 154, 2)
START_TOGETHER_NS = -6_000_000_000


@pytest.fixture(scope="module")
def reference(kitti_drive: ScanSource) -> Trajectory:
    """KISS-ICP's own estimate over the whole drive."""
    run = OdometryRun(OdometrySettings(), [KeyframeSettings()], "whole")
    run.process_all(kitti_drive)
    (found,) = run.results()
    return Trajectory("whole", found.stamps_ns, found.poses)


@pytest.fixture(scope="module")
def dataset(kitti_drive: ScanSource, reference: Trajectory, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The drive as two robots that start together, with a radio simulated from the reference."""
    folder = tmp_path_factory.mktemp("two_robots")
    scans = list(kitti_drive)
    write_ros2_bag(folder / "alpha", [scans[i] for i in A], storage="mcap")
    shifted = [replace(scans[i], stamp_ns=scans[i].stamp_ns + START_TOGETHER_NS) for i in B]
    write_kitti_folder(folder / "beta", shifted)
    alpha = Trajectory("alpha", reference.stamps_ns[A], reference.poses[A])
    beta = Trajectory("beta", reference.stamps_ns[B] + START_TOGETHER_NS, reference.poses[B])
    for truth in (alpha, beta):
        write_tum(folder / f"{truth.robot}_gt.tum", truth)
    radio = RadioSettings(every_m=4.0, direction="reciprocal", paths=5)
    wireless = simulate_wireless_from_poses({"alpha": alpha, "beta": beta}, radio, seed=1)
    write_wireless_log(folder / "wireless.jsonl", wireless)
    robots = {
        "alpha": RobotRecording(folder / "alpha", ground_truth=folder / "alpha_gt.tum"),
        "beta": RobotRecording(folder / "beta", ground_truth=folder / "beta_gt.tum"),
    }
    write_dataset(folder / "dataset.yaml", robots)
    return folder / "dataset.yaml"


def wiclosure(*words: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "wiclosure", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", ["none", "wiclosure"])
def test_two_robots_are_merged(dataset: Path, reference: Trajectory, tmp_path: Path, name: str) -> None:
    out = tmp_path / "run"
    radio = ["--wireless", dataset.parent / "wireless.jsonl"]
    done = wiclosure("run", dataset, *radio, "--filter", name, "--out", out, "--quiet")
    assert done.returncode == 0, done.stderr

    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["components"][0]["robots"] == ["alpha", "beta"]
    assert metrics["alignment"]["alpha-beta"]["translation_error_m"] < 0.3
    assert metrics["alignment"]["alpha-beta"]["rotation_error_deg"] < 0.5
    assert metrics["closures"]["accepted"] >= 5
    assert metrics["closures"]["accepted_false"] == 0
    assert metrics["filter"] == name
    assert metrics["candidates_registrable"]["recall"] == 1.0

    expected = {
        *("config.yaml", "metrics.json", "candidates.csv", "closures.csv", "graph.g2o", "map.ply", "log.jsonl"),
        *(f"{robot}{kind}.tum" for robot in ("alpha", "beta") for kind in ("", "_odometry", "_ground_truth")),
    }
    assert expected <= {p.name for p in out.iterdir()}
    with (out / "candidates.csv").open() as file:
        assert sum(1 for _ in csv.DictReader(file)) == metrics["pairs_kept"]
    # One world: beta's first pose lies where the reference has it, seen from alpha's first.
    alpha, beta = (read_tum(out / f"{robot}.tum", robot) for robot in ("alpha", "beta"))
    expected_m = np.linalg.norm(reference.positions[B[0]] - reference.positions[A[0]])
    assert np.linalg.norm(beta.positions[0] - alpha.positions[0]) == pytest.approx(expected_m, abs=0.3)
