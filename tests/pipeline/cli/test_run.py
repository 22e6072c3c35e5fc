"""The command line as a user meets it: what it prints, its exit codes, and that bad input leaves nothing behind."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from wiclosure.pipeline.data.dataset_writer import write_kitti_folder, write_ros1_bag, write_ros2_bag
from wiclosure.types import Scan

from ..walled_room import room  # noqa: TID252  -- test folders are no packages

SCANS = [Scan(10**9 + k * 10**8, room(k)) for k in range(6)]
OTHER = [Scan(10**9 + k * 10**8, room(100 + k)) for k in range(6)]


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs in an empty folder, with a cache of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path / "cache"))


Call = Callable[..., tuple[int, str, str]]


def refused(result: tuple[int, str, str], *parts: str) -> None:
    """One line on standard error that holds all parts; exit code 1."""
    code, _, err = result
    assert code == 1
    lines = [line for line in err.splitlines() if line.startswith("wiclosure: error: ")]
    assert len(lines) == 1, err
    assert "Traceback" not in err
    for part in parts:
        assert part in lines[0], lines[0]


def nothing_left(folder: Path, *expected: str) -> None:
    assert {p.name for p in folder.iterdir()} - {"cache"} == set(expected)


# -------------------------------------------------------------------------------------------------------- good input
def test_run_writes_everything_and_prints_a_table(wiclosure: Call) -> None:
    write_ros1_bag("alpha.bag", SCANS)
    write_ros2_bag("beta", SCANS, storage="mcap")
    code, out, _ = wiclosure("run", "alpha=alpha.bag", "beta=beta", "--filter", "none", "--out", "run")
    assert code == 0
    assert "filter: none" in out
    assert {"metrics.json", "config.yaml", "map.ply", "alpha.tum", "beta_odometry.tum", "trajectories.png"} <= set(
        os.listdir("run")  # noqa: PTH208
    )
    config = yaml.safe_load(Path("run/config.yaml").read_text())
    assert config["use_filter"] == "none"


def test_no_wireless_log_passes_all_pairs_and_says_so(wiclosure: Call) -> None:
    write_kitti_folder("alpha", SCANS)
    write_kitti_folder("beta", OTHER)
    code, out, _ = wiclosure("run", "alpha", "beta", "--out", "run", "--json", "-q")
    assert code == 0
    metrics = json.loads(out)
    assert metrics["filter"] == "wiclosure"
    assert metrics["pairs_kept"] == metrics["pairs_total"]
    assert any("no measurement" in s or "heard" in s for s in metrics["diagnosis"]), metrics["diagnosis"]


def test_output_over_the_input_is_refused(wiclosure: Call) -> None:
    write_kitti_folder("data/alpha", SCANS)
    refused(wiclosure("run", "alpha=data/alpha", "--out", "data", "--overwrite"), "which is read")
    assert Path("data/alpha/times.txt").exists()


def test_one_robot_is_plain_slam(wiclosure: Call) -> None:
    write_kitti_folder("alpha", SCANS)
    code, out, _ = wiclosure("run", "alpha", "--out", "run")
    assert code == 0
    assert "nothing to merge" in " ".join(out.split())


def test_default_folder_and_latest(wiclosure: Call) -> None:
    write_kitti_folder("alpha", SCANS)
    assert wiclosure("run", "alpha", "-q")[0] == 0
    assert (Path("results/latest") / "metrics.json").is_file()
    assert not Path("results/latest").readlink().is_absolute()


def test_second_run_reuses_odometry(wiclosure: Call) -> None:
    write_kitti_folder("alpha", SCANS)
    wiclosure("run", "alpha", "--out", "first", "-q")
    wiclosure("run", "alpha", "--out", "second", "-q")
    first, second = (Path(f"{name}/alpha_odometry.tum").read_text() for name in ("first", "second"))
    assert first == second
    assert "taken from the cache" in Path("second/log.jsonl").read_text()
    for line in Path("second/log.jsonl").read_text().splitlines():
        assert {"time", "level", "module", "message"} == set(json.loads(line))


def test_compare_shares_odometry(wiclosure: Call) -> None:
    write_kitti_folder("alpha", SCANS)
    write_kitti_folder("beta", SCANS)
    code, out, _ = wiclosure("compare", "alpha", "beta", "--filters", "none,random", "--out", "ab")
    assert code == 0
    assert "none" in out
    assert "random" in out
    runs = json.loads(Path("ab/comparison.json").read_text())["runs"]
    assert [run["filter"] for run in runs] == ["none", "random"]
    base, other = (run["metrics"] for run in runs)
    assert base["seconds"]["odometry"] == other["seconds"]["odometry"] == base["seconds_spent"]["odometry"]
    assert other["seconds_spent"]["odometry"] == 0
    pictures = {"trajectories.png", "ate.png", "funnel.png", "candidates_alpha_beta.png"}
    assert {"comparison.md", "comparison.csv", "none", "random", *pictures} <= {p.name for p in Path("ab").iterdir()}


def test_compare_says_that_recordings_are_one_world(wiclosure: Call) -> None:
    write_kitti_folder("alpha", SCANS)
    write_kitti_folder("beta", SCANS)
    words = ["compare", "alpha", "beta", "--filters", "none,random", "--seeds", "2"]
    code, out, _ = wiclosure(*words, "--out", "ab")
    assert code == 0
    assert "recordings are one world" in " ".join(out.split())
    runs = [
        (run["preset"], run["filter"], run["seed"])
        for run in json.loads(Path("ab/comparison.json").read_text())["runs"]
    ]
    assert runs == [("default", "none", 0), ("default", "random", 0), ("default", "random", 1)]
    assert {str(p.parent.relative_to("ab")) for p in Path("ab").rglob("metrics.json")} == {
        "seed-0/none", "seed-0/random", "seed-1/random"
    }  # fmt: skip


def test_eval_reads_a_run_again(wiclosure: Call) -> None:
    write_kitti_folder("alpha", SCANS, T_world_lidar=np.tile(np.eye(4), (6, 1, 1)))
    wiclosure("run", "alpha", "--out", "run", "-q")
    code, out, _ = wiclosure("eval", "run", "--json")
    assert code == 0
    assert json.loads(out)["ate_m"]["team"] == pytest.approx(
        json.loads(Path("run/metrics.json").read_text())["ate_m"]["team"]
    )


def test_dump_config_is_a_config(wiclosure: Call) -> None:
    code, out, _ = wiclosure("dump-config", "--set", "keyframes.distance_m=2")
    assert code == 0
    Path("mine.yaml").write_text(out)
    assert wiclosure("dump-config", "--config", "mine.yaml")[1] == out


def test_help_of_every_command(wiclosure: Call) -> None:
    code, out, _ = wiclosure("--help")
    assert code == 0
    for command in ("run", "compare", "demo", "split", "eval", "info", "dump-config"):
        assert command in out
        assert wiclosure(command, "--help")[0] == 0
    assert wiclosure()[0] == 0


# --------------------------------------------------------------------------------------------------------- bad input
@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["run"], ["DATA"]),
        (["rnu"], ["rnu", "run"]),
        (["run", "missing.bag"], ["missing.bag", "does not exist"]),
        (["run", "a=alpha", "a=alpha"], ["two robots are named a"]),
        (["run", "alpha", "-n", "0"], ["-n"]),
        (["run", "alpha", "--filter", "wiclosur"], ["wiclosur"]),
        (["run", "alpha", "--config", "missing.yaml"], ["missing.yaml"]),
        (["run", "alpha", "--set", "keyframe.distance_m=1"], ["keyframe", "did you mean"]),
        (["run", "alpha", "--set", "keyframes.distance_m=-1"], ["keyframes.distance_m", "-1"]),
        (["run", "alpha", "--wireless", "missing.jsonl"], ["missing.jsonl"]),
        (["run", "alpha", "--filter", "oracle"], ["ground truth"]),
        (["run", "alpha", "--out", "alpha"], ["alpha, which is read"]),
        (["compare", "alpha", "--filters", ""], ["--filters"]),
        (["compare", "alpha", "--filters", "none,none"], ["named twice"]),
        (["compare", "alpha", "--filters", "none,wiclosur"], ["wiclosur", "did you mean wiclosure"]),
        (["compare", "alpha", "--presets", "stronk"], ["stronk", "did you mean strong"]),
        (["compare", "alpha", "--presets", "strong,strong"], ["strong is named twice"]),
        (["compare", "alpha", "--seeds", "0"], ["--seeds", "1"]),
        (["compare", "scenario:shelspace"], ["did you mean shell-space"]),
        (["compare", "scenario:city", "--seed", "3"], ["--seed", "scenario:city,seed=3"]),
        (["compare", "scenario:city", "alpha"], ["stands alone"]),
        (["info", "missing.bag"], ["missing.bag"]),
        (["eval", "alpha"], ["metrics.json", "wiclosure run"]),
        (["split", "alpha", "--robots", "1", "--out", "parts"], ["--robots"]),
        (["split", "alpha", "--sequence", "08", "--out", "parts"], ["08"]),
    ],
)
def test_bad_words_are_one_line(wiclosure: Call, tmp_path: Path, words: Sequence[str], parts: Sequence[str]) -> None:
    write_kitti_folder("alpha", SCANS)
    refused(wiclosure(*words), *parts)
    nothing_left(tmp_path, "alpha", *(["results"] if Path("results").is_dir() else []))
    assert not any(Path("results").rglob("*")) if Path("results").is_dir() else True


def _jsonl(*records: object) -> None:
    Path("radio.jsonl").write_text("".join((r if isinstance(r, str) else json.dumps(r)) + "\n" for r in records))


HEARD = {"type": "wireless", "stamp": 1.2, "receiver": "alpha", "transmitter": "beta", "range": 3.0, "range_sigma": 0.5}


@pytest.mark.parametrize(
    ("records", "parts"),
    [
        ([HEARD, "{nonsense"], ["radio.jsonl", "line 2"]),
        ([HEARD | {"range": -1.0}], ["radio.jsonl", "line 1", "range"]),
        ([HEARD | {"range": float("nan")}], ["radio.jsonl", "line 1", "range"]),
        ([HEARD | {"transmitter": "gamma"}], ["radio.jsonl", "gamma", "alpha", "beta"]),
        ([HEARD | {"range_sigma": 0}], ["radio.jsonl", "line 1", "sigma"]),
    ],
)
def test_bad_wireless_logs(wiclosure: Call, tmp_path: Path, records: Sequence[object], parts: Sequence[str]) -> None:
    write_kitti_folder("alpha", SCANS)
    write_kitti_folder("beta", OTHER)
    _jsonl(*records)
    refused(wiclosure("run", "alpha", "beta", "-w", "radio.jsonl", "--out", "run"), *parts)
    nothing_left(tmp_path, "alpha", "beta", "radio.jsonl")


def test_angles_in_degrees_are_a_warning(wiclosure: Call) -> None:
    write_kitti_folder("alpha", SCANS)
    write_kitti_folder("beta", OTHER)
    _jsonl(HEARD | {"paths": [{"azimuth": 135.0, "sigma": 0.2, "weight": 1.0}]})
    code, _, err = wiclosure("run", "alpha", "beta", "-w", "radio.jsonl", "--out", "run", "-q")
    assert code == 0
    assert "degrees" in err


def test_truncated_bag_offers_salvage(wiclosure: Call, tmp_path: Path) -> None:
    write_ros1_bag("alpha.bag", SCANS)
    whole = Path("alpha.bag").read_bytes()
    Path("alpha.bag").write_bytes(whole[: len(whole) * 2 // 3])
    refused(wiclosure("run", "alpha.bag", "--out", "run"), "alpha.bag", "--salvage", "messages")
    nothing_left(tmp_path, "alpha.bag")
    assert wiclosure("run", "alpha.bag", "--salvage", "--out", "run", "-q")[0] == 0


def test_several_topics_are_listed(wiclosure: Call) -> None:
    write_ros1_bag("alpha.bag", SCANS)
    refused(wiclosure("run", "alpha.bag", "--topic", "/lidar"), "/lidar", "/points")


def test_unusable_scans_are_counted_in_the_diagnosis(wiclosure: Call) -> None:
    nothing = replace(SCANS[2], points=SCANS[2].points.copy())
    nothing.points[:] = np.nan  # a Scan is not made of these, but a bag may hold them
    write_ros2_bag("alpha", [*SCANS[:2], nothing, *SCANS[3:]])
    code, out, _ = wiclosure("run", "alpha", "--out", "run", "--json")
    assert code == 0
    assert any("1 of 6 scans" in sentence for sentence in json.loads(out)["diagnosis"])


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("900.0 0 0 0 0 0 0 1\n901.0 0 0 0 0 0 0 1\n", "overlap"),
        ("1.70000e+09 0 0 0 0 0 0 1\n1.70000e+09 1 0 0 0 0 0 1\n", "nine decimals"),
        ("not a number in sight\n", "expected 8 numbers"),
        (None, "does not exist"),
    ],
)
def test_ground_truth_that_cannot_be_used_stops_nothing(wiclosure: Call, content: str | None, says: str) -> None:
    write_kitti_folder("alpha", SCANS)
    if content is not None:
        Path("gt.tum").write_text(content)
    Path("dataset.yaml").write_text("robots:\n  alpha: {scans: alpha, ground_truth: gt.tum}\n")
    code, out, _ = wiclosure("run", "dataset.yaml", "--out", "run", "--json")
    assert code == 0
    (sentence,) = [s for s in json.loads(out)["diagnosis"] if "ground truth is left out" in s]
    assert "gt.tum" in sentence
    assert says in sentence
    assert not Path("run/alpha_ground_truth.tum").exists()


def test_robots_of_one_name_in_a_file(wiclosure: Call) -> None:
    write_kitti_folder("alpha", SCANS)
    Path("dataset.yaml").write_text("robots:\n  alpha: {scans: alpha}\n  alpha: {scans: alpha}\n")
    refused(wiclosure("run", "dataset.yaml", "--out", "run"), "dataset.yaml", "alpha")


def test_full_disk_leaves_the_old_result(wiclosure: Call, monkeypatch: pytest.MonkeyPatch) -> None:
    write_kitti_folder("alpha", SCANS)
    wiclosure("run", "alpha", "--out", "run", "-q")
    before = Path("run/metrics.json").read_text()

    def full(self: Path, *_: object, **__: object) -> int:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as broken:
        broken.setattr(Path, "write_text", full)
        refused(wiclosure("run", "alpha", "--out", "run", "--overwrite", "-q"), "No space left")
    assert Path("run/metrics.json").read_text() == before
    assert not list(Path().glob(".run*"))


def long_run(jobs: str) -> subprocess.Popen[str]:
    """A run in a group of processes of its own, with one robot that is soon read and one that is not."""
    write_kitti_folder("alpha", SCANS)
    write_kitti_folder("beta", [replace(OTHER[k % 6], stamp_ns=10**9 + k * 10**8) for k in range(1000)])
    words = ["run", "alpha", "beta", "--out", "run", "-q", "-j", jobs]
    command = [sys.executable, "-m", "wiclosure", *words]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("jobs", "how"), [("1", signal.SIGINT), ("2", signal.SIGINT), ("2", signal.SIGTERM), ("3", signal.SIGHUP)]
)
def test_interrupt_is_clean_and_keeps_finished_stages(tmp_path: Path, jobs: str, how: signal.Signals) -> None:
    process = long_run(jobs=jobs)
    finished = tmp_path / "cache"
    deadline = time.monotonic() + 60
    while not (finished.is_dir() and list(finished.glob("odometry-*"))) and time.monotonic() < deadline:
        time.sleep(0.05)
    if how in (signal.SIGINT, signal.SIGHUP):
        os.killpg(process.pid, how)  # as a terminal does: to the workers too
    else:
        process.send_signal(how)  # as `kill` does: to the command alone
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.strip() == "interrupted: nothing is written; finished odometry is kept, unless with --no-cache"
    assert not Path("run").exists()
    assert not list(tmp_path.glob(".run*"))
    assert len(list(finished.glob("odometry-*"))) == 1
    assert left_in_the_end(process.pid) == []


@pytest.mark.slow
def test_workers_end_with_a_command_that_is_killed() -> None:
    """Also the one that has nothing to do any more, and the process that reads ahead."""
    process = long_run(jobs="4")
    deadline = time.monotonic() + 60
    while not list(Path("cache").glob("odometry-*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(2)
    assert len(left_behind(process.pid)) >= 4  # the command, a worker at rest, one at work, and its reader
    process.kill()
    process.communicate(timeout=60)
    assert left_in_the_end(process.pid) == []


def left_in_the_end(group: int) -> list[str]:
    """`left_behind` once those that are about to end had time to."""
    deadline = time.monotonic() + 20
    while (left := left_behind(group)) and time.monotonic() < deadline:
        time.sleep(0.1)
    return left


def left_behind(group: int) -> list[str]:
    """Commands of the processes of a group, but for the one that only tidies up after the others."""
    processes = subprocess.run(["ps", "-wweo", "pgid=,stat=,args="], capture_output=True, text=True, check=True)
    words = [line.split(maxsplit=2) for line in processes.stdout.splitlines()]
    return [w[2] for w in words if w[0] == str(group) and not w[1].startswith("Z") and "resource_tracker" not in w[2]]


def test_heavy_libraries_wait_until_they_serve() -> None:
    code = (
        "import sys, wiclosure.pipeline.cli; print([m for m in sys.modules if m in {'numpy','open3d','gtsam','scipy'}])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
