from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.graph_files.naming import Pose
from wiclosure.backends.graph_files.poses_of_edges import held_by_edges
from wiclosure.backends.graph_files.records import Edge


def edges(*pairs, may_be_false=None):
    """Edges between poses (robot, number) whose keys are the numbers."""
    ends = [(Pose(*first), Pose(*second)) for first, second in pairs]
    made = [
        Edge(q.number, m.number, f"line {n}", np.eye(4), np.eye(6), may_be_false=may_be_false)
        for n, (q, m) in enumerate(ends)
    ]
    return made, ends


CHAIN = [(("a", n), ("a", n + 3)) for n in range(0, 12, 3)]


@pytest.mark.parametrize(
    ("others", "held"),
    [
        ([], []),
        ([(("a", 3), ("a", 99))], []),  # one edge, and no step: perhaps of a file that is missing
        ([(("a", 3), ("a", 99)), (("a", 6), ("a", 99))], [99]),
        ([(("a", 3), ("b", 99)), (("a", 6), ("b", 99))], []),  # nothing of its own
        ([(("a", 99), ("a", 99))], []),
    ],
)
def test_two_own_edges_or_a_step_hold_a_pose(others, held):
    listed = [Pose("a", 0), Pose("a", 6), Pose("a", 9)]
    found = held_by_edges(*edges(*CHAIN, *others), listed)
    assert sorted(pose.number for pose in found) == [3, 12, *held]
    assert not any(vertex.is_known for vertex in found.values())
    assert (found["a", 12].key, found["a", 12].place) == (12, "line 3")


def test_where_there_are_no_vertices_any_own_edge_holds_a_pose_but_loops_that_may_be_false():
    assert {pose.number for pose in held_by_edges(*edges(*CHAIN, (("a", 3), ("a", 99))), [])} == {0, 3, 6, 9, 12, 99}
    assert not held_by_edges(*edges(*CHAIN, may_be_false=True), [])
