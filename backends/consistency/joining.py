"""Groups of robots joined by the sets of closures that hold."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import networkx as nx
import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled
from wiclosure.backends.sets.candidate_sets import CandidateSet
from wiclosure.types import FloatArray, IntArray


def joined_groups(
    robots: Robots, group: IntArray, settled: Settled, holding: Sequence[CandidateSet], limit: float
) -> tuple[IntArray, FloatArray, list[CandidateSet]]:
    """New groups, poses in their frames, and the sets that joined them or agree with those."""
    best: dict[tuple[int, int], CandidateSet] = {}
    for candidate in sorted(holding, key=lambda c: c.strength):
        best[candidate.a, candidate.b] = candidate
    graph: nx.Graph[int] = nx.Graph()
    graph.add_nodes_from(np.unique(group).tolist())
    for (a, b), candidate in best.items():
        graph.add_edge(a, b, weight=candidate.strength, candidate=candidate)
    tree = nx.maximum_spanning_tree(graph, weight="weight")
    frames: dict[int, FloatArray] = {}
    new_group = group.copy()
    for component in sorted(nx.connected_components(tree), key=min):
        root = min(component)
        frames[root] = np.eye(4)
        for parent, child in nx.bfs_edges(tree, root):
            tree_edge = best[min(parent, child), max(parent, child)]
            frames[child] = frames[parent] @ (
                tree_edge.frame if parent == tree_edge.a else se3.inverse(tree_edge.frame)
            )
        new_group[np.isin(group, list(component))] = root
    T = np.stack([frames[int(g)] for g in group[robots.robot]])
    agreeing = [c for c in best.values() if tree.has_edge(c.a, c.b) or _agrees(c, frames, limit)]
    return new_group, T @ settled.poses, agreeing


def connect(candidates: Sequence[CandidateSet], group: IntArray, new_group: IntArray) -> bool:
    """Whether these sets alone join the groups `(R,)` to the new ones."""
    graph: nx.Graph[int] = nx.Graph()
    graph.add_nodes_from(np.unique(group).tolist())
    graph.add_edges_from((c.a, c.b) for c in candidates)
    return int(nx.number_connected_components(graph)) == len(np.unique(new_group))


def strongest(candidates: Sequence[CandidateSet], about: float) -> list[CandidateSet]:
    """Those that hold and are about as strong as the strongest at one of their groups: the others wait for these.

    Args:
        candidates: all sets.
        about: share of the strength of the strongest from which a set is about as strong.
    """
    best: dict[int, float] = defaultdict(float)
    holding = [c for c in candidates if c.holds]
    for c in holding:
        for end in (c.a, c.b):
            best[end] = max(best[end], c.strength)
    return [c for c in holding if c.strength >= about * min(best[c.a], best[c.b])]


def _agrees(candidate: CandidateSet, frames: dict[int, FloatArray], limit: float) -> bool:
    """Whether a set agrees with where the others put its groups, its own uncertainty alone counted twice."""
    error = se3.log(se3.between(candidate.frame, se3.between(frames[candidate.a], frames[candidate.b])))
    covariance = candidate.noise + candidate.wander @ candidate.wander.T
    return bool(mahalanobis_squared(error[None], 2.0 * covariance[None])[0] <= limit)
