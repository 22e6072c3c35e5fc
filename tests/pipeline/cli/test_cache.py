from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from wiclosure.pipeline.cli import app
from wiclosure.pipeline.runtime.cache import StageCache


def test_the_cache_is_shown_and_cleared(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("WICLOSURE_CACHE", str(tmp_path))
    StageCache(tmp_path).keep("odometry", 1, "x" * 2**20, save=lambda text, path: path.write_text(text) and None)
    runner = CliRunner()
    shown = runner.invoke(app, ["cache"])
    assert shown.exit_code == 0
    assert "odometry" in shown.output
    assert "1.0 MB" in shown.output
    content = json.loads(runner.invoke(app, ["cache", "--json"]).output)
    assert content["stages"] == [{"stage": "odometry", "entries": 1, "size_bytes": 2**20}]
    assert json.loads(runner.invoke(app, ["cache", "--clear", "--json"]).output)["stages"] == []
    assert list(tmp_path.iterdir()) == []
