"""The files of a team's graph: two robots on straight lines, a square apart, with labelled loops."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.odometry_jump import OdometryJump
from wiclosure.formats.trajectories.kitti_poses import read_kitti_poses
from wiclosure.formats.trajectories.tum import read_tum
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.stages.merged_folder import OPTIMISED_COLUMNS, summary, write_merged
from wiclosure.pipeline.stages.optimising import merge_graphs

COUNT = 8
OFFSET = np.array([0.0, 3.0, 0.0])
INFORMATION = " ".join(map(str, np.diag([400.0] * 3 + [10_000.0] * 3)[np.triu_indices(6)]))


def edge(first, second, translation):
    return f"EDGE_SE3:QUAT {first} {second} {' '.join(map(str, translation))} 0 0 0 1 {INFORMATION}"


@pytest.fixture(scope="module")
def merged(tmp_path_factory):
    """Exact odometry along x, five exact loops from a to b and one that is 30 m off."""
    a, b = ord("a") << 56, ord("b") << 56
    lines = [
        f"VERTEX_SE3:QUAT {key + n} {n} {y} 0 0 0 0 1" for key, y in ((a, 0.0), (b, OFFSET[1])) for n in range(COUNT)
    ]
    lines += [edge(key + n, key + n + 1, (1.0, 0, 0)) for key in (a, b) for n in range(COUNT - 1)]
    lines += [edge(a + n, b + n, OFFSET) for n in (0, 1, 3, 5, 7)]
    lines += [edge(a + 2, b + 6, (-26.0, 3.0, 0.0))]
    path = tmp_path_factory.mktemp("graph") / "team.g2o"
    path.write_text("\n".join(lines))
    return merge_graphs([path], Config())


@pytest.fixture
def written(merged, tmp_path):
    write_merged(tmp_path, merged)
    return tmp_path


def test_trajectories_are_the_estimate_in_each_format(merged, written):
    poses = read_tum(written / "b.tum", "b").poses
    np.testing.assert_allclose(poses, merged.graph.trajectories["b"].poses, atol=1e-9)
    np.testing.assert_allclose(read_kitti_poses(written / "b_kitti.txt").poses, poses, atol=1e-6)
    apart = se3.between(merged.graph.trajectories["a"].poses, poses)
    np.testing.assert_allclose(apart[:, :3, 3], np.tile(OFFSET, (COUNT, 1)), atol=1e-3)


def test_every_closure_has_a_row_with_its_decision(written):
    with (written / "closures.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == OPTIMISED_COLUMNS
    accepted = {(row["first"], row["second"]) for row in rows if row["decision"] == "accepted"}
    assert accepted == {(f"a{n}", f"b{n}") for n in (0, 1, 3, 5, 7)}
    (other,) = (row for row in rows if row["decision"] != "accepted")
    assert (other["first"], other["second"]) == ("a2", "b6")
    assert other["reason"]


def test_the_summary_is_what_the_file_holds(merged, written):
    found = summary(merged)
    assert json.loads((written / "summary.json").read_text()) == json.loads(json.dumps(found))
    assert (found["robots"], found["components"]) == ({"a": COUNT, "b": COUNT}, [["a", "b"]])
    assert (found["closures"]["read"], found["closures"]["accepted"]) == (6, 5)
    assert [row["second"] for row in found["closures"]["rejected"]] == ["b6"]
    assert found["doubts"] == []


def test_doubts_stand_first_and_by_themselves(merged):
    jump = OdometryJump("b", 4, np.array([0, 0, 0.1, 2.0, 0, 0]))
    found = summary(replace(merged, consistent=replace(merged.consistent, open_jumps=(jump,))))
    assert found["doubts"] == found["diagnosis"][:1] == [jump.doubt]


@pytest.mark.parametrize(
    ("false", "expected"),
    [
        ({"b6"}, (5, 1, 5, 0, 1.0, 1.0)),
        ({"b6", "b0"}, (4, 2, 4, 1, 0.8, 1.0)),
        ({"b0"}, (5, 1, 4, 1, 0.8, 0.8)),
    ],
)
def test_labels_are_held_against_the_decisions(merged, false, expected):
    edges = tuple(
        replace(edge, is_false=merged.name(closure.match) in false)
        for edge, closure in zip(merged.team.edges, merged.graph.closures, strict=True)
    )
    labels = summary(replace(merged, team=replace(merged.team, edges=edges)))["labels"]
    assert tuple(labels.values()) == pytest.approx(expected)


def test_without_labels_there_are_no_scores(merged):
    assert "labels" not in summary(merged)
