"""docs/start.md, followed with two bags and a table of UWB ranges in millimetres, ends with one map."""

from __future__ import annotations

import json
import re
import shlex
import sys
from pathlib import Path

import pytest

from wiclosure import ScenarioSettings, make_scenario
from wiclosure.pipeline import cli
from wiclosure.pipeline.data.scenarios.scenario_writer import write_scenario
from wiclosure.pipeline.runtime.progress import NoProgress

from .pages import REPOSITORY, text_of

TAGS = {"alpha": 7, "beta": 12}


@pytest.fixture
def site(tmp_path: Path) -> Path:
    """What a user brings: a bag of each kind, and what UWB tags wrote."""
    silent, heard = (
        make_scenario("demo-site", ScenarioSettings.model_validate({"seed": 7, "radio": radio}))
        for radio in ({"max_range_m": 0.001}, {"every_m": 1.0, "bearings": False})
    )
    folder = tmp_path / "site"
    folder.mkdir()
    write_scenario(silent, folder, {"alpha": "ros1", "beta": "ros2-mcap"}, progress=NoProgress())
    for extra in ("dataset.yaml", "wireless.jsonl", "alpha_gt.tum", "beta_gt.tum"):
        (folder / extra).unlink()
    rows = [
        f"{m.stamp_ns / 1e6:.0f},{TAGS[m.receiver]},{TAGS[m.transmitter]},{1e3 * m.range_m:.0f}"
        for m in heard.wireless().measurements
        if m.range_m is not None
    ]
    (folder / "uwb.csv").write_text("\n".join(["time_ms,tag,anchor,distance_mm", *rows]) + "\n")
    return folder


@pytest.mark.slow
def test_the_page_leads_to_one_map(site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path / "cache"))
    blocks = "\n".join(
        re.findall(r"^```sh\n(.*?)^```$", text_of(REPOSITORY / "docs" / "start.md"), re.DOTALL | re.MULTILINE)
    )
    commands = [line for line in blocks.splitlines() if line.startswith("wiclosure ")]
    assert [shlex.split(line)[1] for line in commands] == ["init", "run", "run", "radio", "compare"]
    metrics = {}
    for line in commands:
        monkeypatch.setattr(sys, "argv", shlex.split(line.replace("~/data/site", str(site)), comments=True))
        with pytest.raises(SystemExit) as ended:
            cli.main()
        assert ended.value.code == 0, line
        if (written := tmp_path / "results" / "latest" / "metrics.json").is_file():
            metrics[line] = json.loads(written.read_text(encoding="utf-8"))
    whole = metrics[commands[2]]
    assert [part["robots"] for part in whole["components"]] == [["alpha", "beta"]]
