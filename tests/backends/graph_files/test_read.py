from __future__ import annotations

import json
from pathlib import Path

import pytest

from wiclosure.backends.graph_files.read import read_records
from wiclosure.backends.graph_files.records import Remarks
from wiclosure.errors import InputError


@pytest.fixture
def write(forms, tmp_path):
    """A text graph, or a robot log, under a name."""
    team = forms.random_team(1)

    def write(name: str) -> Path:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        is_log = path.suffix in {".jrl", ".json", ".log"}
        lines = [line for robot in forms.lines(team, forms.symbols) for line in robot]
        path.write_text(json.dumps(forms.robot_log(team)) if is_log else "\n".join(lines))
        return path

    return write


@pytest.mark.parametrize(
    ("name", "is_log"),
    [("team.jrl", True), ("team.json", True), ("team.log", True), ("team.g2o", False), ("team", False)],
)
def test_the_name_or_a_first_brace_tells_the_format(write, name, is_log):
    (records,) = read_records([write(name)], Remarks())
    assert records.is_robot_log is is_log
    assert (records.name.removesuffix(".log"), len(records.edges) > 0) == ("team", True)


def test_files_of_one_stem_are_told_apart_by_their_folder_and_then_by_a_number(write):
    paths = [write("one/graph.g2o"), write("two/graph.g2o"), write("two/graph.txt"), write("other.g2o")]
    names = [records.name for records in read_records(paths, Remarks())]
    assert names == ["one_graph", "two_graph_1", "two_graph_2", f"{paths[3].parent.name}_other"]
    assert [records.name for records in read_records([paths[0], paths[3]], Remarks())] == ["graph", "other"]


def test_one_file_given_twice_is_refused_however_it_is_written(write):
    path = write("graph.g2o")
    with pytest.raises(InputError, match=r"graph\.g2o is given twice; give each graph once"):
        read_records([path, path.parent / "." / "graph.g2o"], Remarks())
