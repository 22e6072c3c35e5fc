from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.data.dataset_writer import write_kitti_folder
from wiclosure.pipeline.data.radio_check import log_and_trajectories
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.types import Scan, Trajectory, WirelessLog, WirelessMeasurement


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """Two recordings, a TUM file of each robot and other ones, and a radio log."""
    for number, robot in enumerate(("alpha", "beta")):
        write_kitti_folder(tmp_path / robot, [Scan(k * 10**8, np.ones((9, 3))) for k in range(3)])
        for kind, step in (("gt", 1.0), ("odom", 2.0), ("other", 3.0)):
            poses = np.tile(np.eye(4), (3, 1, 1))
            poses[:, 0, 3] = step * np.arange(3) + number
            write_tum(tmp_path / f"{robot}_{kind}.tum", Trajectory(robot, np.arange(3) * 10**8, poses))
    heard = WirelessMeasurement(10**8, "alpha", "beta", 1.5, 0.1)
    write_wireless_log(tmp_path / "radio.jsonl", WirelessLog((heard,)))
    return tmp_path


def dataset(site: Path, **alpha: str) -> list[str]:
    known = "".join(f", {key}: {value}" for key, value in alpha.items())
    (site / "dataset.yaml").write_text(
        f"robots:\n  alpha: {{scans: alpha{known}}}\n  beta: {{scans: beta, odometry: beta_odom.tum}}\n"
        "wireless: [radio.jsonl]\n"
    )
    return [str(site / "dataset.yaml")]


@pytest.mark.parametrize(
    ("alpha", "words", "step_m"),
    [
        ({"odometry": "alpha_odom.tum", "ground_truth": "alpha_gt.tum"}, [], 2.0),
        ({"ground_truth": "alpha_gt.tum"}, [], 1.0),
        ({"odometry": "alpha_odom.tum"}, ["alpha=alpha_other.tum", "beta=beta_other.tum"], 3.0),
    ],
    ids=["its odometry", "else its ground truth", "what is named goes before"],
)
def test_the_path_of_a_robot_of_a_data_set(
    site: Path, alpha: dict, words: list[str], step_m: float, monkeypatch
) -> None:
    monkeypatch.chdir(site)
    log, found, _ = log_and_trajectories(dataset(site, **alpha), [], words)
    assert len(log.measurements) == 1
    assert list(found) == ["alpha", "beta"]
    assert np.diff(found["alpha"].positions[:, 0]).tolist() == pytest.approx([step_m, step_m])


def test_a_robot_without_any_path_is_named_with_the_way_out(site: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"alpha has neither odometry nor ground_truth .* give --trajectory alpha=FILE"
    ):
        log_and_trajectories(dataset(site), [], [])


def test_sources_and_named_trajectories_without_a_data_set(site: Path, monkeypatch) -> None:
    monkeypatch.chdir(site)
    words = ["alpha=alpha_gt.tum", "beta=beta_gt.tum"]
    log, found, _ = log_and_trajectories([], [RadioSource(path=Path("radio.jsonl"))], words)
    assert (len(log.measurements), list(found)) == (1, ["alpha", "beta"])


def test_nothing_to_check(site: Path, monkeypatch) -> None:
    monkeypatch.chdir(site)
    with pytest.raises(ConfigError, match="nothing to check: give a data set, or a log with --wireless"):
        log_and_trajectories([], [], [])
    (site / "empty.jsonl").write_text("")
    words = ["alpha=alpha_gt.tum", "beta=beta_gt.tum"]
    with pytest.raises(InputError, match="the log holds no measurements"):
        log_and_trajectories([], [RadioSource(path=Path("empty.jsonl"))], words)


def test_a_log_in_the_place_of_a_data_set_is_told_from_one(site: Path) -> None:
    log = str(site / "radio.jsonl")
    with pytest.raises(ConfigError, match=r"radio.jsonl is a radio log, no data set; name it with --wireless .*radio"):
        log_and_trajectories([log], [], [])
