"""`wiclosure radio` on the command line."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from wiclosure.formats.radio.wireless_log import read_wireless_log
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline import cli
from wiclosure.types import Trajectory


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two robots that drive apart on bent paths, and the millimetres between them."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")
    time_s = np.arange(120.0)
    places = {
        "alpha": np.column_stack([time_s, 9 * np.sin(time_s / 9), 0 * time_s]),
        "beta": np.column_stack([30 - time_s / 2, 20 + 15 * np.cos(time_s / 13), 0 * time_s]),
    }
    for robot, positions in places.items():
        poses = np.tile(np.eye(4), (len(time_s), 1, 1))
        poses[:, :3, 3] = positions
        write_tum(tmp_path / f"{robot}.tum", Trajectory(robot, (time_s * 1e9).astype(np.int64), poses))
    between = np.linalg.norm(places["alpha"] - places["beta"], axis=1)
    rows = [f"{s:.0f},7,12,{1000 * r:.0f}" for s, r in zip(time_s, between, strict=True)]
    Path("uwb.csv").write_text("\n".join(["t,from,to,range", *rows]) + "\n")
    return tmp_path


def called(monkeypatch: pytest.MonkeyPatch, *words: str) -> object:
    monkeypatch.setattr(sys, "argv", ["wiclosure", "radio", *words])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code


WORD = "uwb.csv,robots.7=alpha,robots.12=beta,max_range=1e9"
PATHS = ("-t", "alpha=alpha.tum", "-t", "beta=beta.tum")


def test_check_says_what_to_add_and_adding_it_helps(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called(monkeypatch, "check", "-w", WORD, *PATHS, "--json") == 0
    assert json.loads(capsys.readouterr().out)["settings"] == {"unit": "mm"}
    assert called(monkeypatch, "check", "-w", f"{WORD},unit=mm", *PATHS, "--json") == 0
    assert json.loads(capsys.readouterr().out)["settings"] == {}
    assert called(monkeypatch, "check", "-w", WORD, *PATHS) == 0
    assert "unit: mm" in capsys.readouterr().out


def test_convert_writes_what_is_read_and_never_unasked(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called(monkeypatch, "convert", f"{WORD},unit=mm", "-o", "w.jsonl") == 0
    log = read_wireless_log("w.jsonl")
    assert len(log.measurements) == 120
    assert called(monkeypatch, "convert", "w.jsonl", "-o", "w.jsonl") == 1
    assert "exists already" in capsys.readouterr().err
    assert called(monkeypatch, "convert", "w.jsonl", "-o", "again.jsonl") == 0
    assert read_wireless_log("again.jsonl") == log


def test_info_as_json_and_presets(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called(monkeypatch, "info", f"{WORD},unit=mm", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["kind"], found["pairs"][0]["robots"], found["pairs"][0]["ranges"]) == (
        "table",
        ["alpha", "beta"],
        120,
    )
    assert called(monkeypatch, "info", "--presets") == 0
    assert "miluv" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("check",), "nothing to check"),
        (("check", "-w", "uwb.csv,robots.7=alpha", *PATHS), "map them with robots: {12: NAME}"),
        (("check", "-w", WORD, "-t", "alpha=alpha.tum"), "one trajectory only"),
        (("info", "gone.csv"), "does not exist"),
        (("info",), "name a log"),
    ],
)
def test_mistakes_are_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], says: str
) -> None:
    assert called(monkeypatch, *words) == 1
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("wiclosure: error")]
    assert len(error) == 1
    assert says in error[0]
