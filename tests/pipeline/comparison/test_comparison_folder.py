from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.pipeline.comparison.comparison_folder import write_comparison
from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.report import pictures


def test_tables_and_pictures_of_all_arms(repeated: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "DPI", 40)
    write_comparison(tmp_path, repeated)
    assert {path.name for path in tmp_path.iterdir()} == {
        "comparison.csv", "comparison.json", "comparison.md", "ate.png", "funnel.png"
    }  # fmt: skip
