from __future__ import annotations

from collections.abc import Callable

import pytest

from wiclosure.pipeline.report.stage_lines import StageLines
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.pipeline.stages.viewer import Together
from wiclosure.types import Closure


def test_a_line_for_each_stage(
    run_of: Callable[..., RunResult], lost_run: RunResult, capsys: pytest.CaptureFixture[str]
) -> None:
    run = run_of()
    lines = StageLines("none")
    said = Together([lines])
    assert not said.follows_scans
    said.fronts(run.fronts)
    said.candidates(run.solution.filtered)
    said.closures([Closure(c.query, c.match) for c in run.solution.closures])
    said.closures(run.solution.closures)
    said.result(run)
    told = capsys.readouterr().err.splitlines()
    assert all(line.startswith("none: ") for line in told)
    starts = [
        "odometry of alpha",
        "odometry of beta",
        "filter wiclosure",
        "matching",
        "registration",
        "estimate",
        "map",
    ]
    assert [line.removeprefix("none: ").startswith(begin) for line, begin in zip(told, starts, strict=True)] == [
        True
    ] * 7
    StageLines().result(lost_run)
    assert "not connected: " in capsys.readouterr().err


def test_where_nothing_is_proposed_it_is_said_once(capsys: pytest.CaptureFixture[str]) -> None:
    lines = StageLines()
    lines.closures([])
    lines.closures([])
    assert capsys.readouterr().err == "matching: 0 closures proposed\n"
