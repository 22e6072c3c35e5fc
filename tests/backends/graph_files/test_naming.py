from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.graph_files.naming import pose_name
from wiclosure.backends.graph_files.team import read_graphs
from wiclosure.errors import InputError


def read(folder, **files):
    paths = []
    for name, lines in files.items():
        paths.append(folder / f"{name}.g2o")
        paths[-1].write_text("\n".join(lines) + "\n")
    return read_graphs(paths)


@pytest.fixture
def chain(forms):
    """Lines of one robot with the keys that a function gives; `step_m` from pose to pose."""

    def lines(keys, n=4, step_m=1.0):
        T = np.eye(4)
        T[0, 3] = step_m
        team = forms.WrittenTeam([np.tile(T, (n - 1, 1, 1))], [])
        return forms.lines(team, lambda _, k: keys(k))[0]

    return lines


def test_two_characters_with_the_same_label_are_two_robots(chain, tmp_path):
    label = ord("A") << 48
    lines = chain(lambda k: (ord("g") << 56) + label + k) + chain(lambda k: (ord("h") << 56) + label + k, 5)
    assert {robot: len(t) for robot, t in read(tmp_path, team=lines).odometry.items()} == {"gA": 4, "hA": 5}


def test_labels_that_are_no_characters_are_numbers(chain, tmp_path):
    lines = chain(lambda k: (ord("g") << 56) + (1 << 48) + k) + chain(lambda k: (ord("g") << 56) + (2 << 48) + k)
    assert list(read(tmp_path, team=lines).odometry) == ["1", "2"]


def test_a_character_that_two_files_use_differently_is_one_robot_a_file(chain, forms, tmp_path):
    key = lambda k: (ord("x") << 56) + k  # noqa: E731
    team = read(tmp_path, north=chain(key), south=chain(key, step_m=2.0))
    assert list(team.odometry) == ["north", "south"]
    assert any("the same numbers for different poses" in sentence for sentence in team.warnings)


def test_a_robot_in_two_files_is_one_robot(chain, forms, tmp_path):
    key = lambda k: (ord("x") << 56) + k  # noqa: E731
    team = read(tmp_path, north=chain(key), south=chain(key, 6))
    assert {robot: len(t) for robot, t in team.odometry.items()} == {"x": 6}
    assert not team.closures


def test_files_of_one_name_in_two_folders_keep_apart(chain, tmp_path):
    paths = []
    for folder in ("north", "south"):
        (tmp_path / folder).mkdir()
        paths.append(tmp_path / folder / "graph.g2o")
        paths[-1].write_text("\n".join(chain(lambda k: k)))
    assert list(read_graphs(paths).odometry) == ["north_graph", "south_graph"]
    with pytest.raises(InputError, match="given twice"):
        read_graphs([paths[0], paths[0]])


def test_plain_numbers_are_told_from_a_symbol_that_is_called_like_the_file(chain, tmp_path):
    team = read(tmp_path, a=chain(lambda k: k), b=chain(lambda k: (ord("a") << 56) + k, 5))
    assert {robot: len(t) for robot, t in team.odometry.items()} == {"a": 5, "a.g2o": 4}


@pytest.mark.parametrize(
    ("robot", "name"), [("a", "a7"), ("a.1", "a7"), ("alpha", "alpha 7"), ("0", "0 7"), ("alpha.1", "alpha.1 7")]
)
def test_poses_are_named_as_users_know_them(robot, name):
    assert pose_name(robot, 7) == name


def test_files_of_edges_alone_share_their_numbers_where_they_do_not_contradict_each_other(forms, tmp_path):
    team = forms.random_team(5, 2, size=8)
    north, south = forms.lines(team, lambda r, n: 100 * r + n)
    edges = {
        name: [line for line in lines if not line.startswith("VERTEX")]
        for name, lines in (("north", north), ("south", south))
    }
    edges["south"] += [line for line in edges["north"] if abs(int(line.split()[1]) - int(line.split()[2])) > 50]
    found = read(tmp_path, **edges)
    assert {robot: keys.tolist() for robot, keys in found.keys.items()} == {
        "north": list(range(8)),
        "south": list(range(100, 108)),
    }
    assert len(found.closures) == len(team.loops)


@pytest.mark.parametrize("key", [lambda r, n: 3 * n + r, lambda r, n: 20 * r + n], ids=["in turn", "one by one"])
def test_files_of_edges_alone_tell_robots_however_numbers_are_dealt_out(key, forms, tmp_path):
    team = forms.random_team(7, 3, size=20, n_loops=40)
    edges = [[line for line in lines if line.startswith("EDGE")] for lines in forms.lines(team, key)]
    loops = {frozenset(key(*end) for end in (query, match)): (query[0], match[0]) for query, match, _ in team.loops}
    for line in {line for lines in edges for line in lines}:  # a loop stands in the files of both robots
        for robot in loops.get(frozenset(map(int, line.split()[1:3])), ()):
            edges[robot] += [line] if line not in edges[robot] else []
    found = read(tmp_path, a=edges[0], b=edges[1], c=edges[2])
    assert {robot: keys.tolist() for robot, keys in found.keys.items()} == {
        robot: [key(r, n) for n in range(20)] for r, robot in enumerate("abc")
    }


def test_files_of_edges_alone_have_their_own_numbers_where_they_contradict_each_other(chain, tmp_path):
    edges = [[line for line in chain(int, step_m=step) if line.startswith("EDGE")] for step in (1.0, 2.0)]
    found = read(tmp_path, north=edges[0], south=edges[1])
    assert {robot: len(t) for robot, t in found.odometry.items()} == {"north": 4, "south": 4}
