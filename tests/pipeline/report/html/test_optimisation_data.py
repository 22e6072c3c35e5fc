"""Two robots' graphs as files have them, their indices from 100 on: six closures that agree and one that does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wiclosure.backends.odometry_jump import OdometryJump
from wiclosure.pipeline.config import load_config
from wiclosure.pipeline.report.html import write_optimisation_report
from wiclosure.pipeline.report.html.page import read_page
from wiclosure.pipeline.report.merged_tables import merged_tables
from wiclosure.pipeline.stages.merged_folder import summary
from wiclosure.pipeline.stages.optimising import MergedGraphs, merge_graphs

FIRST = 100
INFORMATION = "100 0 0 0 0 0 100 0 0 0 0 100 0 0 0 100 0 0 100 0 100"


def key(robot: str, index: int) -> int:
    return (ord(robot) << 56) + index


def line(robot: str, y_m: float, poses: int = 12) -> list[str]:
    rows = [f"VERTEX_SE3:QUAT {key(robot, FIRST + n)} {n} {y_m} 0 0 0 0 1" for n in range(poses)]
    return rows + [
        f"EDGE_SE3:QUAT {key(robot, FIRST + n)} {key(robot, FIRST + n + 1)} 1 0 0 0 0 0 1 {INFORMATION}"
        for n in range(poses - 1)
    ]


@pytest.fixture
def merged(tmp_path: Path) -> MergedGraphs:
    closures = [
        f"EDGE_SE3:QUAT {key('a', FIRST + n)} {key('b', FIRST + n)} 0 2 0 0 0 0 1 {INFORMATION}" for n in range(6)
    ]
    false = f"EDGE_SE3:QUAT {key('a', FIRST)} {key('b', FIRST + 11)} 0 0 9 0 0 0 1 {INFORMATION}"
    path = tmp_path / "graph.g2o"
    path.write_text("\n".join([*line("a", 0.0), *line("b", 0.0), *closures, false]) + "\n")
    return merge_graphs([path], load_config())


def test_closures_have_the_files_indices_and_their_reasons(merged: MergedGraphs, tmp_path: Path) -> None:
    write_optimisation_report(tmp_path, merged, load_config())
    report = read_page(tmp_path / "report.html")
    assert report["title"] == "a and b: merged graphs"
    (run,) = report["runs"]
    assert run["verdict"]["sentence"] == "All 2 robots in one frame; 6 of 7 closures accepted."
    (rejected,) = [c for c in run["closures"] if c["decision"] == "rejected"]
    assert (rejected["query"], rejected["match"]) == (["a", FIRST], ["b", FIRST + 11])
    assert rejected["reason"]
    assert run["funnel"][0] == {"stage": "read", "count": 7, "true": None, "false": None, "reasons": []}
    assert run["funnel"][-1]["count"] == 6
    reasons = [reason for stage in run["funnel"] for reason in stage["reasons"]]
    assert [(reason["text"], reason["count"]) for reason in reasons] == [(rejected["reason"], 1)]


def test_a_jump_of_odometry_that_nothing_tells_is_said_first(merged: MergedGraphs, tmp_path: Path) -> None:
    jump = OdometryJump("b", 4, np.array([0, 0, 0.1, 2.0, 0, 0]))
    doubtful = replace(merged, consistent=replace(merged.consistent, open_jumps=(jump,)))
    write_optimisation_report(tmp_path, doubtful, load_config())
    verdict = read_page(tmp_path / "report.html")["runs"][0]["verdict"]
    assert (verdict["tone"], verdict["next"]) == ("warn", [jump.doubt])
    assert "6 of 7 closures accepted; the map may be wrong" in verdict["sentence"]
    assert "may be wrong" in str(merged_tables(summary(doubtful))[0].columns[1]._cells)


def test_robots_that_nothing_joins(tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    path.write_text("\n".join([*line("a", 0.0), *line("b", 0.0)]) + "\n")
    write_optimisation_report(tmp_path, merge_graphs([path], load_config()), load_config())
    (run,) = read_page(tmp_path / "report.html")["runs"]
    assert run["verdict"]["tone"] == "bad"
    assert "not all connected (a; b)" in run["verdict"]["sentence"]
    assert [robot["connected"] for robot in run["robots"]] == [True, False]


def test_a_map_in_doubt_is_said_to_be_so_first(tmp_path: Path) -> None:
    path = tmp_path / "graph.g2o"
    vague = [row.replace(INFORMATION, INFORMATION.replace("100", "0.01")) for row in line("a", 0.0, 40)]
    ends = [(key("a", FIRST + n), key("a", FIRST + n + 20)) for n in (3, 9)]
    loops = [f"EDGE_SE3:QUAT {i} {j} 20 0 0 0 0 0 1 {INFORMATION}" for i, j in ends]
    path.write_text("\n".join([*vague, *loops]) + "\n")
    merged = merge_graphs([path], load_config())
    (doubt,) = summary(merged)["doubts"]
    assert doubt.startswith("a: the map may be wrong: closures within its path are accepted")
    write_optimisation_report(tmp_path, merged, load_config())
    verdict = read_page(tmp_path / "report.html")["runs"][0]["verdict"]
    assert (verdict["tone"], verdict["next"]) == ("warn", [doubt])
    assert verdict["sentence"] == "One robot; 2 of 2 closures accepted; the map may be wrong."
