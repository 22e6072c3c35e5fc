"""`wiclosure filter` on files: the plug-in contract."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.formats.radio.wireless_log import read_wireless_log
from wiclosure.formats.radio.wireless_log_writer import write_wireless_log
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline import cli
from wiclosure.pipeline.report.html.page import read_page
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import Trajectory, WirelessLog

Call = Callable[..., tuple[int, str, str]]


def winding(name: str, start_m: float, direction: float) -> Trajectory:
    """A drive of 300 m along one winding road, `T_world_body`."""
    x = start_m + direction * np.linspace(0.0, 300.0, 151)
    position = np.stack([x, 25.0 * np.sin(x / 35.0), np.zeros_like(x)], axis=1)
    ahead = np.gradient(position, axis=0)
    return Trajectory(
        name, np.arange(151) * 10**9 + 10**12, se3.from_yaw(np.arctan2(ahead[:, 1], ahead[:, 0]), position)
    )


@pytest.fixture
def files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Trajectory]:
    """Odometry of two robots and what they heard, as files in the current folder; true poses by robot."""
    monkeypatch.chdir(tmp_path)
    truth = {"alpha": winding("alpha", 0.0, 1.0), "beta": winding("beta", 420.0, -1.0)}
    for robot, trajectory in truth.items():
        write_tum(f"{robot}.tum", trajectory.moved(se3.inverse(trajectory.poses[0])))
    write_wireless_log("radio.jsonl", simulate_wireless_from_poses(truth, RadioSettings(paths=5), seed=3))
    return truth


@pytest.fixture
def wiclosure(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Call:
    """`wiclosure filter` on both trajectories; exit code, standard output, standard error."""

    def call(*words: str) -> tuple[int, str, str]:
        robots = [] if "-t" in words else ["-t", "alpha=alpha.tum", "-t", "beta=beta.tum"]
        log = [] if "-w" in words else ["-w", "radio.jsonl"]
        monkeypatch.setattr(sys, "argv", ["wiclosure", "filter", *robots, *log, *words])
        with pytest.raises(SystemExit) as stopped:
            cli.main()
        out, err = capsys.readouterr()
        return int(stopped.value.code or 0), out, err

    return call


def test_true_pairs_are_kept_and_others_pruned(files: dict[str, Trajectory], wiclosure: Call) -> None:
    code, out, err = wiclosure("-o", "candidates.csv", "--summary", "summary.json")
    assert (code, err) == (0, "")
    assert "candidate pairs" in out
    with Path("candidates.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == [
        *("robot_a", "index_a", "stamp_a", "robot_b", "index_b", "stamp_b", "mahalanobis", "overlap_probability")
    ]
    kept = {(int(r["index_a"]), int(r["index_b"])) for r in rows}
    assert all(r["robot_a"] == "alpha" and r["robot_b"] == "beta" for r in rows)
    assert rows[0]["stamp_a"] == f"{1000 + int(rows[0]['index_a'])}.000000000"
    apart = np.linalg.norm(files["alpha"].positions[:, None] - files["beta"].positions, axis=2)
    near = {(int(a), int(b)) for a, b in np.argwhere(apart <= 35.0)}
    assert len(near & kept) >= 0.99 * len(near)
    assert len(near & kept) >= 0.6 * len(kept)

    summary = json.loads(Path("summary.json").read_text())
    assert summary["pairs_total"] == 151 * 151
    assert summary["pairs_kept"] == len(rows)
    assert summary["seconds"] > 0
    assert summary["peak_rss_mb"] > 0
    (alignment,) = summary["alignments"]
    assert {"robot_a", "robot_b", "T_a_b", "covariance", "ambiguous", "reason", "paths_kept", "runner_up"} <= set(
        alignment
    )
    assert not alignment["ambiguous"]
    T_a_b = np.reshape(alignment["T_a_b"], (4, 4))
    true_T_a_b = se3.between(files["alpha"].poses[0], files["beta"].poses[0])
    error = se3.log(se3.between(T_a_b, true_T_a_b))
    covariance = np.reshape(alignment["covariance"], (6, 6))
    assert error @ np.linalg.solve(covariance, error) < 22.5  # chi-square, 6 degrees of freedom, 99.9 %


def test_pictures_are_drawn_with_a_page(files: dict[str, Trajectory], wiclosure: Call) -> None:
    assert wiclosure("--plot", "pictures", "--quiet") == (0, "", "")
    (picture,) = Path("pictures").glob("*.png")
    assert picture.stat().st_size > 10_000
    report = read_page(Path("pictures/report.html"))
    assert "closure_odds" in Path("pictures/config.yaml").read_text()  # what the page says to run again with
    assert report["title"] == "alpha and beta: pairs that the filter wiclosure keeps"
    assert report["runs"][0]["radio"][0]["certain"]


def test_no_measurement_passes_all_pairs_and_says_so(files: dict[str, Trajectory], wiclosure: Call) -> None:
    Path("empty.jsonl").write_text("")
    code, out, _ = wiclosure("-w", "empty.jsonl", "--json")
    assert code == 0
    summary = json.loads(out)
    assert summary["pairs_kept"] == summary["pairs_total"] == 151 * 151
    assert any("no measurement" in sentence for sentence in summary["diagnosis"])


@pytest.mark.parametrize(("policy", "code", "kept"), [("pass", 0, 151 * 151), ("reject", 0, 0), ("raise", 1, None)])
def test_policy_where_the_radio_cannot_tell(
    files: dict[str, Trajectory], wiclosure: Call, policy: str, code: int, kept: int | None
) -> None:
    log = simulate_wireless_from_poses(files, RadioSettings(paths=5), seed=3)
    write_wireless_log("one.jsonl", WirelessLog(log.measurements[:1]))
    got, out, err = wiclosure("-w", "one.jsonl", "--json", "--set", f"filter.on_ambiguous={policy}")
    assert got == code
    if kept is None:
        assert err.count("\n") == 1
        assert "on_ambiguous" in err
    else:
        assert json.loads(out)["pairs_kept"] == kept


def test_other_filters_work_on_files_too(files: dict[str, Trajectory], wiclosure: Call) -> None:
    for name in ("none", "range-gate", "random"):
        assert json.loads(wiclosure("--filter", name, "--json")[1])["filter"] == name


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["-t", "alpha"], "NAME=FILE"),
        (["-t", "alpha=alpha.tum", "-t", "alpha=beta.tum"], "alpha twice"),
        (["-t", "alpha=alpha.tum"], "one trajectory only"),
        (["-t", "alpha=alpha.tum", "-t", "beta=missing.tum"], "missing.tum"),
        (["-t", "alpha=alpha.tum", "-t", "gamma=beta.tum"], "beta"),
        (["-o", "alpha.tum"], "alpha.tum exists"),
        (["-w", "missing.jsonl"], "missing.jsonl"),
        (["--filter", "oracle"], "ground truth"),
        (["--set", "filter.gate.min_probability=2"], "min_probability"),
    ],
)
def test_bad_input_is_one_line(files: dict[str, Trajectory], wiclosure: Call, words: list[str], part: str) -> None:
    before = {p.name for p in Path().iterdir()}
    code, _, err = wiclosure(*words)
    assert code == 1
    assert err.count("\n") == 1
    assert part in err
    assert {p.name for p in Path().iterdir()} == before


def test_a_robot_that_stands_still_is_one_pose(files: dict[str, Trajectory], wiclosure: Call) -> None:
    one = files["beta"].subset(np.array([0]))
    write_tum("one.tum", one)
    code, out, _ = wiclosure("-t", "alpha=alpha.tum", "-t", "beta=one.tum", "--json")
    assert code == 0
    assert json.loads(out)["pairs_total"] == 151


def test_measurements_of_another_time_are_counted(files: dict[str, Trajectory], wiclosure: Call) -> None:
    log = simulate_wireless_from_poses(files, RadioSettings(paths=5), seed=3)
    late = tuple(replace(m, stamp_ns=m.stamp_ns + 10**13) for m in log.measurements)
    write_wireless_log("late.jsonl", WirelessLog(late))
    code, out, _ = wiclosure("-w", "late.jsonl", "--json")
    assert code == 0
    summary = json.loads(out)
    assert summary["pairs_kept"] == summary["pairs_total"]
    assert any(str(len(late)) in sentence for sentence in summary["diagnosis"]), summary["diagnosis"]


def test_the_filter_pulls_in_no_lidar_library() -> None:
    code = (
        "import sys; from wiclosure.wiclosure_filter import make_filter; make_filter('wiclosure');"
        "print([m for m in ('open3d', 'kiss_icp', 'small_gicp', 'rosbags', 'typer', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_log_of_another_time_is_said_with_what_explains_it(files: dict[str, Trajectory], wiclosure: Call) -> None:
    log = read_wireless_log("radio.jsonl")
    write_wireless_log(
        "late.jsonl",
        replace(log, measurements=tuple(replace(m, stamp_ns=m.stamp_ns + 7200 * 10**9) for m in log.measurements)),
    )
    code, _, err = wiclosure("-w", "late.jsonl")
    assert code == 0
    assert "moved by -2 hours it fits: a time zone" in err
    assert "time_offset: -7200" in err


def test_a_log_that_holds_nothing_is_said(files: dict[str, Trajectory], wiclosure: Call) -> None:
    Path("empty.jsonl").write_text("")
    assert wiclosure("-w", "empty.jsonl")[::2] == (0, "wiclosure: warning: empty.jsonl: it holds no readings\n")
