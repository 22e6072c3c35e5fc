from __future__ import annotations

import importlib.util
import json
from collections.abc import Callable
from pathlib import Path

import pytest

Call = Callable[..., tuple[int, str, str]]
WORDS = ("scenario:shell-space", "--config", "small-site", "-n", "4", "--no-cache", "--quiet", "--filter", "none")


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def figures(folder: str) -> dict[str, object]:
    """What a run found, without what it took."""
    metrics = json.loads(Path(folder, "metrics.json").read_text())
    return {name: value for name, value in metrics.items() if name not in {"seconds", "seconds_spent", "peak_rss_mb"}}


def test_a_recording_of_a_run_changes_nothing_of_it(wiclosure: Call) -> None:
    pytest.importorskip("rerun")
    assert wiclosure("run", *WORDS, "--out", "plain")[0] == 0
    assert wiclosure("run", *WORDS, "--out", "kept", "--save-rrd", "kept/run.rrd", "-v")[0] == 0
    assert Path("kept/run.rrd").stat().st_size > 10_000
    assert figures("plain") == figures("kept")
    for name in ("alpha.tum", "beta.tum", "closures.csv", "map.ply"):
        assert Path("plain", name).read_bytes() == Path("kept", name).read_bytes()


def test_each_arm_has_a_recording(wiclosure: Call) -> None:
    pytest.importorskip("rerun")
    words = [word for word in WORDS if word not in {"--filter", "none"}]
    assert wiclosure("compare", *words, "--filters", "none,oracle", "--out", "ab", "--save-rrd", "ab.rrd")[0] == 0
    assert {path.name for path in Path().glob("*.rrd")} == {"ab-none.rrd", "ab-oracle.rrd"}


@pytest.mark.parametrize("command", [("run", *WORDS), ("demo", "--quiet")])
def test_without_the_viewer_one_line_names_the_extra(
    wiclosure: Call, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    find = importlib.util.find_spec
    monkeypatch.setattr(
        "wiclosure.pipeline.cli.viewing.find_spec", lambda name: None if name == "rerun" else find(name)
    )
    code, _, err = wiclosure(*command, "--save-rrd", "a.rrd", "--out", "out")
    assert code == 1
    assert err.count("\n") == 1
    assert "pip install 'wiclosure[viz]'" in err
    assert not Path("out").exists()


def test_a_file_is_not_replaced_unasked_and_has_the_viewers_ending(wiclosure: Call) -> None:
    pytest.importorskip("rerun")
    Path("a.rrd").write_text("mine")
    code, _, err = wiclosure("run", *WORDS, "--save-rrd", "a.rrd", "--out", "out")
    assert code == 1
    assert "a.rrd exists already" in err
    Path("ab-none.rrd").write_text("mine")
    words = [word for word in WORDS if word not in {"--filter", "none"}]
    code, _, err = wiclosure("compare", *words, "--save-rrd", "ab.rrd", "--out", "out")
    assert code == 1
    assert "ab-none.rrd exists already" in err
    assert Path("ab-none.rrd").read_text() == "mine"
    assert Path("a.rrd").read_text() == "mine"
    code, _, err = wiclosure("run", *WORDS, "--save-rrd", "a.bag", "--out", "out")
    assert code == 1
    assert "the ending .rrd" in err
