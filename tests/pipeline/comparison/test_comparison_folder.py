from __future__ import annotations

from pathlib import Path

import pytest

from wiclosure.pipeline.comparison.comparison_folder import write_comparison
from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.report import pictures
from wiclosure.pipeline.report.html.page import PAGE, read_page, write_page


def test_tables_pictures_and_page_of_all_arms(
    repeated: Comparison, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pictures, "DPI", 40)
    for outcome in repeated.outcomes:
        folder = tmp_path / outcome.folder
        folder.mkdir(parents=True)
        run = {"name": outcome.filter, "robots": [{"name": "alpha"}, {"name": "beta"}], "map": None, "map_note": ""}
        counts = {"pairs_kept": 5, "closures": {"proposed": 9, **outcome.metrics["closures"]}}
        write_page(folder / PAGE, {"title": "", "runs": [run], "metrics": outcome.metrics | counts})
    write_comparison(tmp_path, repeated)
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {
        "comparison.csv", "comparison.json", "comparison.md", "ate.png", "funnel.png", "report.html"
    }  # fmt: skip
    report = read_page(tmp_path / PAGE)
    assert report["title"].startswith("alpha and beta: comparison of none and wiclosure, presets strong and loose")
    assert [run["name"] for run in report["runs"]] == [
        "strong none",
        "strong wiclosure",
        "loose none",
        "loose wiclosure",
    ]
    assert report["look_at"] == 1
    side_by_side = report["tables"][0]
    assert side_by_side["header"][1:] == [run["name"] for run in report["runs"]]
