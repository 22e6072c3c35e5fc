"""Full disks, kills, and inputs that change: nothing is lost, wrong or left behind."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).with_name("inject.py")


@pytest.mark.slow
@pytest.mark.hours
@pytest.mark.parametrize("seed", range(5))
def test_nothing_is_lost_wrong_or_left(seed: int, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, SCRIPT, "42", str(seed), tmp_path / "scratch"],
        capture_output=True, text=True, timeout=3600, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]
    found = json.loads(done.stdout)
    assert found["wrong"] == []
    assert sum(found["counts"].values()) == 42
