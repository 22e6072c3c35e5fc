"""`wiclosure simulate` as a user meets it: options of the radio, one line for every problem, whole or nothing."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from wiclosure.pipeline import cli
from wiclosure.pipeline.cli.simulate import ScenarioOptions
from wiclosure.pipeline.data.dataset import load_dataset
from wiclosure.pipeline.data.scenarios.scenario_source import scenario_settings
from wiclosure.simulation import make_scenario
from wiclosure.simulation.sensors.radio import RadioSettings


def radio(world: ScenarioOptions) -> RadioSettings:
    return make_scenario("static-mirror", scenario_settings(world.words(), "simulate")).radio


def test_what_is_not_chosen_stays_the_scenarios_own() -> None:
    assert radio(ScenarioOptions()) == make_scenario("static-mirror").radio


def test_options_of_the_radio() -> None:
    chosen = radio(
        ScenarioOptions(
            radio_every_m=3,
            radio_reach_m=40,
            radio_dropout=0.2,
            direct_absent=0.25,
            reciprocal=True,
            heading_sigma_deg=4,
            set_=["radio.paths=2"],
        )
    )
    assert (chosen.every_m, chosen.every_s, chosen.max_range_m, chosen.dropout) == (3, 2, 40, 0.2)
    assert (chosen.direct_absent, chosen.direct_absent_blocked) == (0.25, 0.25)
    assert (chosen.direction, chosen.heading_sigma_deg, chosen.paths) == ("reciprocal", 4, 2)
    assert radio(ScenarioOptions(heading_sigma_deg=4, no_headings=True)).heading_sigma_deg is None


def test_paths_are_taken_as_they_are(tmp_path: Path) -> None:
    schedule = tmp_path / "08: first, #1.csv"
    schedule.write_text("start_s,end_s\n0,5\n")
    assert len(radio(ScenarioOptions(schedule=schedule)).schedule) == 1


POSES = "1 0 0 0 0 1 0 0 0 0 1 "
"""A line of KITTI poses but for the last number."""

BAD = {
    "words.txt": "one two three\n",
    "short.txt": "1 2 3\n" * 30,
    "few.txt": f"{POSES}0\n" * 5,
    "still.txt": f"{POSES}0\n" * 30,
    "crooked.txt": "1 2 3 4 5 6 7 8 9 10 11 12\n" * 30,
    "nan.txt": f"{POSES}nan\n" * 30,
    "columns.csv": "from,to\n1,2\n",
    "numbers.csv": "start_s,end_s\nnow,later\n",
    "backwards.csv": "start_s,end_s\n5,2\n",
    "stranger.csv": "start_s,end_s,robot_a\n0,5,alfa\n",
}


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["shell_space"], ["did you mean shell-space"]),
        (["static-mirror", "--robots", "0"], ["0 robots", "1 to 2"]),
        (["static-mirror", "--lidar", "vlp-16"], ["did you mean vlp16"]),
        (["static-mirror", "--seed", "-1"], ["--seed"]),
        (["static-mirror", "--radio-dropout", "1.5"], ["--radio-dropout"]),
        (["static-mirror", "--radio-every-m", "-3"], ["radio.every_m = -3"]),
        (["static-mirror", "--heading-deg", "-3"], ["--heading-deg"]),
        (["static-mirror", "--set", "lidar_range_sigma_m=-0.1"], ["lidar_range_sigma_m = -0.1"]),
        (["static-mirror", "--set", "radio.pathes=3"], ["did you mean radio.paths"]),
        (["static-mirror", "--format", "ros3"], ["ros3", "ros2-mcap"]),
        (["static-mirror", "--schedule", "missing.csv"], ["missing.csv"]),
        (["static-mirror", "--schedule", "columns.csv"], ["columns.csv", "start_s,end_s"]),
        (["static-mirror", "--schedule", "numbers.csv"], ["numbers.csv, line 2", "seconds"]),
        (["static-mirror", "--schedule", "backwards.csv"], ["backwards.csv, line 2", "ends"]),
        (["static-mirror", "--schedule", "stranger.csv"], ["'alfa'", "did you mean alpha"]),
        (["static-mirror", "--out", "short.txt/data"], ["short.txt"]),
        (["static-mirror", "--out", "/proc/data"], ["/proc", "--out"]),
        (["kitti08"], ["--poses"]),
        (["kitti08", "--poses", "missing.txt"], ["missing.txt"]),
        (["kitti08", "--poses", "words.txt"], ["words.txt", "12 numbers per line"]),
        (["kitti08", "--poses", "short.txt"], ["short.txt", "30 lines of 3 numbers"]),
        (["kitti08", "--poses", "few.txt"], ["few.txt", "5 lines"]),
        (["kitti08", "--poses", "still.txt"], ["still.txt", "less than 50 m"]),
        (["kitti08", "--poses", "crooked.txt"], ["crooked.txt, line 1", "rotation"]),
        (["kitti08", "--poses", "nan.txt"], ["nan.txt", "finite"]),
    ],
)
def test_bad_words_are_one_line_and_leave_nothing(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    words: list[str],
    parts: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, text in BAD.items():
        Path(name).write_text(text)
    monkeypatch.setattr(sys, "argv", ["wiclosure", "simulate", "--out", "new/data", *words])
    with pytest.raises(SystemExit, match="1"):
        cli.main()
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1, lines
    assert all(part in lines[0] for part in parts), lines[0]
    assert {path.name for path in tmp_path.rglob("*")} == set(BAD)


def test_an_interrupted_simulation_leaves_nothing(tmp_path: Path) -> None:
    words = ["simulate", "demo-site", "--lidar", "hdl64", "--out", "data"]
    command = subprocess.Popen(
        [sys.executable, "-m", "wiclosure", *words], cwd=tmp_path, stderr=subprocess.PIPE, text=True
    )
    started = time.monotonic()
    while not any(path.stat().st_size > 10**6 for path in tmp_path.rglob("*.mcap")):
        assert time.monotonic() - started < 60
        assert command.poll() is None
        time.sleep(0.05)
    assert not list(tmp_path.rglob("dataset.yaml"))
    command.send_signal(signal.SIGINT)
    _, message = command.communicate(timeout=30)
    assert command.returncode == cli.INTERRUPTED
    assert "interrupted" in message
    assert list(tmp_path.iterdir()) == []


def test_what_is_written_can_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["wiclosure"])
    with pytest.raises(SystemExit, match="0"):
        cli.app(
            ["simulate", "static-mirror", "--robots", "1", "--out", str(tmp_path / "data"), "-q", "--format", "kitti"]
        )
    assert (tmp_path / "data" / "plan.png").stat().st_size > 1_000
    dataset = load_dataset([str(tmp_path / "data")])
    assert list(dataset.robots) == ["alpha"]
    truth = dataset.ground_truth("alpha")
    assert truth is not None
    np.testing.assert_allclose(truth.poses, make_scenario("static-mirror").ground_truth("alpha").poses, atol=1e-9)
