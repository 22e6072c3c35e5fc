"""The robots in named poses and edges, and the odometry of each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wiclosure.backends.graph_files.edge_table import EdgeTable, edge_table
from wiclosure.backends.graph_files.matrices import Covariances
from wiclosure.backends.graph_files.naming import Pose, pose_name
from wiclosure.backends.graph_files.odometry_tree import OdometryTree, odometry_tree
from wiclosure.backends.graph_files.records import Edge, Remarks, Vertex
from wiclosure.backends.graph_files.robots import by_own_edges, connected
from wiclosure.errors import InputError
from wiclosure.types import BoolArray, IntArray


@dataclass(frozen=True, eq=False)
class NamedGraph:
    """What stands in all files, with names.

    Args:
        poses: sorted by robot and index.
        vertices: of each pose.
        edges: in the order of the files.
        ends: the poses that each joins; not all need have a vertex.
        stated: covariance and defect of each edge.
        unnamed: robots that only a file's name tells, and so edges must.
    """

    poses: list[Pose]
    vertices: list[Vertex]
    edges: list[Edge]
    ends: list[tuple[Pose, Pose]]
    stated: Covariances
    unnamed: frozenset[str]

    @cached_property
    def numbers(self) -> IntArray:
        """`(E, 2)` places in `poses` of the poses that each edge joins, -1 where there is no vertex."""
        number = {pose: n for n, pose in enumerate(self.poses)}
        return np.array([[number.get(end, -1) for end in pair] for pair in self.ends], np.int64).reshape(-1, 2)

    @cached_property
    def own(self) -> BoolArray:
        """`(E,)`: edges between two poses of one name."""
        same = np.array([first.robot == second.robot for first, second in self.ends], bool)
        return np.asarray(same & (self.numbers >= 0).all(axis=1))

    @cached_property
    def usable(self) -> BoolArray:
        """`(E,)`: edges without defect."""
        return np.array([not defect for defect in self.stated.defects], bool)

    def table(self, rows: IntArray) -> EdgeTable:
        """Some of the edges as arrays."""
        guesses = np.stack([vertex.T_world_body for vertex in self.vertices])
        T = np.array([self.edges[n].T_first_second for n in rows]).reshape(-1, 4, 4)
        may_be_false = np.array([bool(self.edges[n].may_be_false) for n in rows], bool)
        return edge_table(self.numbers[rows], T, self.stated.matrices[rows], may_be_false, guesses)


@dataclass(frozen=True, eq=False)
class Part:
    """A robot: its poses `(N,)`, places in `NamedGraph.poses`; its odometry; the rows of the edges that state it."""

    robot: str
    poses: IntArray
    odometry: OdometryTree
    rows: IntArray


def parts(graph: NamedGraph, remarks: Remarks) -> list[Part]:
    """All robots; `remarks` get those that names do not tell.

    Raises:
        InputError: an edge that should be odometry is not usable, and no other holds the robot together.
    """
    rows = np.flatnonzero(graph.own & graph.usable)
    table, taken = graph.table(rows), {pose.robot for pose in graph.poses}
    found: list[Part] = []
    for robot, first, size in _runs(graph.poses):
        inside = (table.first >= first) & (table.first < first + size)
        local = table[inside].renumbered(np.arange(len(graph.poses)) - first)
        labels = _by_first_pose((by_own_edges if robot in graph.unnamed else connected)(size, local))
        _require_usable(graph, robot, first, labels)
        names = _part_names(robot, int(labels.max()) + 1, taken)
        of_robot = [
            _part(name, np.flatnonzero(labels == label), first, local, rows[inside]) for label, name in enumerate(names)
        ]
        _tell(graph, robot, of_robot, remarks)
        found += of_robot
    return found


def _part(name: str, members: IntArray, first: int, local: EdgeTable, rows: IntArray) -> Part:
    inside = np.isin(local.first, members) & np.isin(local.second, members)
    number = np.zeros(int(max(local.second.max(initial=0), local.first.max(initial=0), members[-1])) + 1, np.int64)
    number[members] = np.arange(len(members))
    tree = odometry_tree(len(members), local[inside].renumbered(number))
    return Part(name, first + members[tree.order], tree, rows[inside][tree.rows])


def _by_first_pose(labels: IntArray) -> IntArray:
    """The same labels as 0, 1, ... in the order of their first poses."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse]


def _runs(poses: Sequence[Pose]) -> Iterator[tuple[str, int, int]]:
    """Name, first place, and number of poses of each robot."""
    names, first, size = np.unique([pose.robot for pose in poses], return_index=True, return_counts=True)
    yield from zip(names.tolist(), first.tolist(), size.tolist(), strict=True)


def _part_names(robot: str, count: int, taken: set[str]) -> list[str]:
    """The name itself, then `a.1`, `a.2`, ... for `a`, in the order of their first poses."""
    names, number = [robot], 0
    while len(names) < count:
        number += 1
        if (name := f"{robot}.{number}") not in taken:
            names.append(name)
    return names


def _require_usable(graph: NamedGraph, robot: str, first: int, labels: IntArray) -> None:
    """Edges between consecutive poses are odometry: one that cannot be used is no loop to leave out."""
    for row in np.flatnonzero(graph.own & ~graph.usable):
        one, other = np.sort(graph.numbers[row] - first)
        inside = one >= 0 and other < len(labels) and other - one == 1
        if inside and not graph.edges[row].may_be_false and labels[one] != labels[other]:
            defect = graph.stated.defects[row]
            raise InputError(f"{graph.edges[row].place}: odometry of {robot}: {defect}; correct the line")


def _tell(graph: NamedGraph, robot: str, found: Sequence[Part], remarks: Remarks) -> None:
    """Says where a name has several robots, or a robot's odometry is no chain."""
    if len(found) > 1 and robot in graph.unnamed:
        sizes = ", ".join(f"{part.robot} ({len(part.poses)} poses)" for part in found[:10])
        more = f" and {len(found) - 10} more" if len(found) > 10 else ""
        remarks.add(f"robots {robot}", f"the edges of {robot} make {len(found)} robots: {sizes}{more}")
    elif len(found) > 1:
        for part in found[1:]:
            start = pose_name(*graph.poses[part.poses[0]])
            said = f"the odometry of {robot} is broken: none of its edges leads to {start}; the rest is {part.robot}"
            remarks.add(f"broken {robot}", said)
    for part in found:
        if not part.odometry.is_chain:
            loose = int((np.abs(np.diff(graph.numbers[part.rows], axis=1)) != 1).sum())
            remarks.add(
                f"no chain {part.robot}",
                f"the odometry of {part.robot} is no chain of consecutive poses: {loose} other edges of its own join"
                f" its {len(part.poses)} poses",
            )
