from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.report.html import Arm, write_again, write_comparison_report, write_run_report
from wiclosure.pipeline.report.html import report as module
from wiclosure.pipeline.report.html.page import read_page
from wiclosure.pipeline.stages.run_result import RunResult

Runs = Callable[..., RunResult]
SUMMARY = {"of": "comparison of none and wiclosure", "verdict": {"tone": "good", "sentence": "Well."}, "tables": []}


def test_one_file_that_can_be_written_again_from_itself(lost_run: RunResult, tmp_path: Path) -> None:
    write_run_report(tmp_path, lost_run)
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    page = tmp_path / "report.html"
    before = page.read_bytes()
    assert b"src=" not in before.split(b'id="report-data"')[0]
    assert write_again(tmp_path) == page
    assert page.read_bytes() == before


def test_what_the_page_holds_of_a_run(lost_run: RunResult, tmp_path: Path) -> None:
    write_run_report(tmp_path, lost_run)
    report = read_page(tmp_path / "report.html")
    assert report["title"] == "alpha, beta and gamma: run with the filter wiclosure"
    (run,) = report["runs"]
    assert [robot["connected"] for robot in run["robots"]] == [True, True, False]
    assert len(run["closures"]) == len(lost_run.solution.closures)
    assert len(run["matrices"]) == 3
    assert len(run["radio"]) == 2
    assert report["metrics"] == json.loads(json.dumps(lost_run.metrics))
    assert "gamma" in run["map_note"]
    assert {"wiclosure", "python", "numpy", "gtsam"} <= set(run["versions"])


def test_arms_share_what_they_have_in_common(run_of: Runs, tmp_path: Path) -> None:
    arms = []
    for name in ("none", "wiclosure"):
        (tmp_path / name).mkdir()
        write_run_report(tmp_path / name, run_of(map_points=20_000))
        arms.append(Arm(name, tmp_path / name))
    write_comparison_report(tmp_path, SUMMARY, arms)
    report = read_page(tmp_path / "report.html")
    assert [run["name"] for run in report["runs"]] == ["none", "wiclosure"]
    assert report["title"] == "alpha and beta: comparison of none and wiclosure"
    sizes = [path.stat().st_size for path in (tmp_path / "report.html", tmp_path / "none" / "report.html")]
    assert sizes[0] < 1.1 * sizes[1]  # both arms are alike here


def test_maps_of_arms_are_thinned(run_of: Runs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "COMPARED_POINTS", 1_000)
    write_run_report(tmp_path, run_of())
    arm = Arm("none", tmp_path)
    (tmp_path / "both").mkdir()
    write_comparison_report(tmp_path / "both", SUMMARY, [arm, arm])
    runs = read_page(tmp_path / "both" / "report.html")["runs"]
    assert [run["map"]["shown"] for run in runs] == [500, 500]
    assert runs[0]["map_note"].startswith("500 of the map's 2,000 points are drawn")


def test_a_folder_without_a_report(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"holds no report\.html; give a folder that wiclosure run"):
        write_again(tmp_path)


def test_one_robot_and_no_radio(run_of: Runs, tmp_path: Path) -> None:
    write_run_report(tmp_path, run_of(("alone",)))
    (run,) = read_page(tmp_path / "report.html")["runs"]
    assert run["matrices"] == run["radio"] == run["closures"] == []
