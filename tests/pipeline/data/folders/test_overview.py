from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.data.dataset_writer import write_ros1_bag
from wiclosure.pipeline.data.folders.overview import overview
from wiclosure.types import Scan, Trajectory, WirelessLog, WirelessMeasurement


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """A recording, ground truth, a table of ranges, and something else."""
    folder = tmp_path / "site"
    folder.mkdir()
    write_ros1_bag(folder / "alpha.bag", [Scan(k * 10**8 + 10**18, np.ones((20, 3)) * (k + 1)) for k in range(3)])
    write_ros1_bag(tmp_path / "beta.bag", [Scan(k * 10**8 + 10**18, np.ones((20, 3)) * (k + 1)) for k in range(3)])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = np.arange(3)
    write_tum(folder / "truth.tum", Trajectory("alpha", 10**18 + np.arange(3) * 10**8, poses))
    (folder / "uwb.csv").write_text("time_ms,tag,anchor,distance_mm\n1000000000000,1,2,500\n")
    (folder / "notes.md").write_text("hello")
    return folder


def lines(path: Path) -> dict[str, tuple[str, str]]:
    return {entry.path.name: (entry.what.splitlines()[0], entry.use) for entry in overview(path)}


def test_without_a_data_set_everything_is_listed_and_nothing_used(site: Path) -> None:
    found = lines(site)
    assert list(found) == ["alpha.bag", "notes.md", "truth.tum", "uwb.csv"]
    assert found["alpha.bag"] == ("recording: ROS 1 bag, 0 s, 3 messages", "")
    assert found["truth.tum"][0] == "trajectory: 3 poses (TUM), 0 s, 2 m"
    assert found["uwb.csv"][0].startswith("radio: table (")
    assert found["notes.md"] == ("unknown: .md: not read", "")


def test_with_a_data_set_each_file_has_its_use_and_files_elsewhere_are_added(site: Path) -> None:
    (site / "dataset.yaml").write_text(
        "robots:\n  alpha: {scans: alpha.bag, ground_truth: truth.tum}\n  beta: {scans: ../beta.bag}\n"
        "wireless: [{path: uwb.csv, robots: {1: alpha, 2: beta}}]\n"
    )
    found = lines(site)
    assert {name: use for name, (_, use) in found.items() if use} == {
        "alpha.bag": "scans of alpha",
        "dataset.yaml": "data set",
        "truth.tum": "ground truth of alpha",
        "uwb.csv": "wireless",
        "beta.bag": "scans of beta",
    }
    assert found["beta.bag"][0] == "elsewhere"
    assert lines(site / "dataset.yaml") == found


def test_a_bag_with_radio_of_its_own_is_read_for_both(site: Path) -> None:
    heard = WirelessLog((WirelessMeasurement(10**18, "alpha", "beta", 5.0, 0.3),))
    scans = [Scan(k * 10**8 + 10**18, np.ones((20, 3)) * (k + 1)) for k in range(3)]
    write_ros1_bag(site / "gamma.bag", scans, wireless=heard)
    assert lines(site)["gamma.bag"][1] == ""
    (site / "dataset.yaml").write_text("robots: {alpha: {scans: gamma.bag}, beta: {scans: alpha.bag}}\n")
    found = lines(site)
    assert (found["gamma.bag"][1], found["alpha.bag"][1]) == ("scans of alpha, wireless", "scans of beta")


def test_one_file_is_one_line_and_a_recording_has_more_to_show_elsewhere(site: Path) -> None:
    assert list(lines(site / "uwb.csv")) == ["uwb.csv"]
    assert overview(site / "alpha.bag") == overview(site / "gone") == []


def test_a_malformed_data_set_is_an_error(site: Path) -> None:
    (site / "dataset.yaml").write_text("robots: [")
    with pytest.raises(InputError, match=r"dataset\.yaml"):
        overview(site)
