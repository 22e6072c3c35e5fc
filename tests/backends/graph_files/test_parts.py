from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.graph_files.matrices import Covariances
from wiclosure.backends.graph_files.naming import Pose
from wiclosure.backends.graph_files.parts import NamedGraph, parts
from wiclosure.backends.graph_files.records import Edge, Remarks, Vertex
from wiclosure.errors import InputError

AHEAD = se3.from_yaw(0.0, np.array([1.0, 0.0, 0.0]))


def graph(robots, ends, *, unnamed=(), defects=()):
    """Robots of so many poses a metre apart; edges between (robot, index)."""
    poses = [Pose(robot, n) for robot, size in sorted(robots.items()) for n in range(size)]
    vertices = [
        Vertex(k, f"a.g2o, line {k}", se3.from_yaw(0.0, np.array([float(pose.number), 0.0, 0.0])))
        for k, pose in enumerate(poses)
    ]
    named = [(Pose(*first), Pose(*second)) for first, second in ends]
    edges = [
        Edge(
            n,
            n,
            f"a.g2o, line {100 + n}",
            se3.from_yaw(0.0, np.array([float(second.number - first.number), 0, 0])),
            None,
        )
        for n, (first, second) in enumerate(named)
    ]
    stated = Covariances(
        np.tile(np.eye(6) * 0.01, (len(ends), 1, 1)), [dict(defects).get(n, "") for n in range(len(ends))]
    )
    return NamedGraph(poses, vertices, edges, named, stated, frozenset(unnamed))


def chain(robot, size, without=()):
    return [((robot, n), (robot, n + 1)) for n in range(size - 1) if n not in without]


def test_each_name_is_a_robot_with_the_edges_of_its_odometry():
    ends = [*chain("a", 4), *chain("b", 3), (("a", 3), ("b", 0)), (("a", 0), ("a", 3))]
    remarks = Remarks()
    found = parts(graph({"a": 4, "b": 3}, ends), remarks)
    assert [(part.robot, part.poses.tolist(), part.rows.tolist()) for part in found] == [
        ("a", [0, 1, 2, 3], [0, 1, 2]),
        ("b", [4, 5, 6], [3, 4]),
    ]
    assert remarks.sentences() == ()


def test_what_breaks_off_gets_a_name_that_no_other_has():
    remarks = Remarks()
    found = parts(graph({"a": 6, "a.1": 2}, [*chain("a", 6, without=[2]), *chain("a.1", 2)]), remarks)
    assert [(part.robot, len(part.poses)) for part in found] == [("a", 3), ("a.2", 3), ("a.1", 2)]
    assert remarks.sentences() == ("the odometry of a is broken: none of its edges leads to a3; the rest is a.2",)


def test_robots_that_only_their_edges_tell_are_counted():
    ends = [*chain("graph", 20, without=[9]), (("graph", 2), ("graph", 15))]
    one = graph({"graph": 20}, ends, unnamed={"graph"})
    one.edges[-1] = replace(one.edges[-1], T_first_second=AHEAD)  # a loop, which the guesses do not know
    remarks = Remarks()
    assert [(part.robot, len(part.poses)) for part in parts(one, remarks)] == [("graph", 10), ("graph.1", 10)]
    assert "make 2 robots: graph (10 poses), graph.1 (10 poses)" in remarks.sentences()[0]


def test_a_step_that_cannot_be_used_and_that_nothing_replaces_is_an_error():
    ends = chain("a", 5)
    with pytest.raises(InputError, match=r"^a\.g2o, line 102: odometry of a: no rotation; correct the line$"):
        parts(graph({"a": 5}, ends, defects={2: "no rotation"}), Remarks())
    remarks = Remarks()
    (whole,) = parts(graph({"a": 5}, [*ends, (("a", 1), ("a", 4))], defects={2: "no rotation"}), remarks)
    assert sorted(whole.rows.tolist()) == [0, 1, 3, 4]
    assert "no chain of consecutive poses: 1 other edges" in remarks.sentences()[0]


def test_edges_to_poses_without_a_vertex_are_nobodys():
    one = graph({"a": 2}, [*chain("a", 2), (("a", 1), ("a", 9))])
    assert one.numbers.tolist() == [[0, 1], [1, -1]]
    assert one.own.tolist() == [True, False]
    assert len(one.table(np.array([0]))) == 1
