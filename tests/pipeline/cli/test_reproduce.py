from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from wiclosure.pipeline.comparison.reproduction import ARMS

Call = Callable[..., tuple[int, str, str]]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("kitti8",), "did you mean kitti08"),
        (("kitti08",), "name its poses with --poses FILE"),
        (("shell-space", "--poses", "08.txt"), "takes no --poses; leave it out"),
        (("shell-space", "--set", "pcm.probabilty=1"), "probabilty"),
    ],
)
def test_what_cannot_be_reproduced_is_one_line_and_writes_nothing(
    wiclosure: Call, tmp_path: Path, words: tuple[str, ...], says: str
) -> None:
    code, printed, error = wiclosure("reproduce", *words, "--out", tmp_path / "out")
    assert (code, printed) == (1, "")
    assert says in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_the_hall_with_its_table_beside_the_papers(wiclosure: Call, tmp_path: Path) -> None:
    code, printed, _ = wiclosure("reproduce", "shell-space", "-n", 40, "--out", tmp_path / "out", "--no-cache")
    assert code == 0
    assert "Table II" in printed
    assert "| Total Wi-Closure time (s) | N/A | 0.5 |" in (tmp_path / "out" / "reproduce.md").read_text()
    runs = json.loads((tmp_path / "out" / "comparison.json").read_text())["runs"]
    assert [(run["preset"], run["filter"]) for run in runs] == [(p, f) for p in ("disco-park", "strong") for f in ARMS]
