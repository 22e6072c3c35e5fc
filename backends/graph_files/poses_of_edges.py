"""Poses that have no vertex: edges tell that they are there."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Collection, Sequence

import numpy as np

from wiclosure.backends.graph_files.naming import Pose
from wiclosure.backends.graph_files.records import Edge, Vertex


def held_by_edges(
    edges: Sequence[Edge], ends: Sequence[tuple[Pose, Pose]], listed: Collection[Pose]
) -> dict[Pose, Vertex]:
    """Vertices without a guess of poses that the files do not list, but that edges of their own robot hold.

    Writers leave out vertices that a solver does not need, but an edge to a pose of a missing file looks alike.  So
    where files have vertices, two own edges hold a pose, or one whose leap from number to number is the most frequent
    of its robot; where they have none, any own edge does.

    Args:
        edges: of all files.
        ends: the poses that each joins.
        listed: poses that have a vertex.
    """
    own = [
        (edge, pair)
        for edge, pair in zip(edges, ends, strict=True)
        if pair[0].robot == pair[1].robot and pair[0] != pair[1] and not edge.may_be_false
    ]
    leaps: defaultdict[str, Counter[int]] = defaultdict(Counter)
    neighbours: defaultdict[Pose, set[Pose]] = defaultdict(set)
    for _, (first, second) in own:
        leaps[first.robot][abs(first.number - second.number)] += 1
        neighbours[first].add(second)
        neighbours[second].add(first)
    usual = {robot: counts.most_common(1)[0][0] for robot, counts in leaps.items()}
    found: dict[Pose, Vertex] = {}
    for edge, (first, second) in own:
        steps = abs(first.number - second.number) == usual[first.robot]
        for pose, key in ((first, edge.first), (second, edge.second)):
            if pose not in listed and (not listed or steps or len(neighbours[pose]) > 1):
                found.setdefault(pose, Vertex(key, edge.place, np.full((4, 4), np.nan)))
    return found
