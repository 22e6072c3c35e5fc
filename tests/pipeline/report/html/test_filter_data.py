from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from wiclosure.pipeline.config import Config
from wiclosure.pipeline.report.html import write_filter_report
from wiclosure.pipeline.report.html.filter_data import filter_data
from wiclosure.pipeline.report.html.packing import unpacked_array
from wiclosure.pipeline.report.html.page import read_page
from wiclosure.pipeline.stages.run_result import RunResult


def test_paths_lie_as_certain_alignments_say(lost_run: RunResult) -> None:
    own = {robot: front.keyframes for robot, front in lost_run.fronts.items()}
    data = filter_data(lost_run.solution.filtered, own, lost_run.inputs.wireless, Config())
    alpha, beta, gamma = (unpacked_array(robot["merged"]) for robot in data["robots"])
    truth = lost_run.inputs.ground_truth
    apart = np.linalg.norm(truth["alpha"].positions - truth["beta"].positions, axis=1)
    np.testing.assert_allclose(np.linalg.norm(alpha - beta, axis=1), apart, atol=0.02)
    assert [robot["connected"] for robot in data["robots"]] == [True, True, False]
    assert gamma[:, 0].min() > max(alpha[:, 0].max(), beta[:, 0].max())
    certain, ambiguous = data["radio"]
    np.testing.assert_allclose(unpacked_array(certain["estimate"]), unpacked_array(certain["range"]), atol=0.01)
    assert ambiguous["ends"] is None


def test_verdict_says_what_is_not_certain(lost_run: RunResult) -> None:
    own = {robot: front.keyframes for robot, front in lost_run.fronts.items()}
    found = filter_data(lost_run.solution.filtered, own, lost_run.inputs.wireless, Config())["verdict"]
    assert found["tone"] == "warn"
    assert found["sentence"].endswith("; 1 of 2 alignments by the radio are certain.")
    assert found["next"][0].startswith("The radio does not tell how beta and gamma lie")


def test_a_filter_without_alignments(lost_run: RunResult, tmp_path: Path) -> None:
    own = {robot: front.keyframes for robot, front in lost_run.fronts.items()}
    result = replace(lost_run.solution.filtered, filter_name="none", alignments=())
    write_filter_report(tmp_path, result, own, lost_run.inputs.wireless, Config())
    report = read_page(tmp_path / "report.html")
    assert report["title"] == "alpha, beta and gamma: pairs that the filter none keeps"
    assert report["runs"][0]["verdict"]["tone"] == "good"
