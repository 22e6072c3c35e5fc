"""The example that users copy runs, and finds the meeting place."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "plug_in.py"


def test_the_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    scope = runpy.run_path(str(EXAMPLE))
    printed = capsys.readouterr().out
    found = re.search(r"compare (\d+) of 40000 pairs", printed)
    assert found is not None
    # About one pair in eight is within 35 m on this road.
    assert 2000 < int(found.group(1)) < 12_000
    assert printed.count("overlap") == 3
    assert "moved by 0 m: agrees" in printed
    assert "moved by 20 m: contradicts the prediction" in printed
    assert not scope["result"].alignments[0].ambiguous
