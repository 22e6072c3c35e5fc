"""A robot's odometry out of its own edges: a chain where there is one, else a spanning tree of what can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import networkx as nx
import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.graph_files.edge_table import EdgeTable
from wiclosure.types import BoolArray, FloatArray, IntArray

ODOMETRY_SHARE = 0.9  # of the consecutive pairs: where so many have an edge, these are the odometry
REACH = float(np.sqrt(chi2.ppf(0.95, 6)))  # sigmas at which an edge begins to lose its weight


@dataclass(frozen=True, eq=False)
class OdometryTree:
    """Steps from pose to pose.

    Args:
        order: `(N,)` the poses, every one after the one that its step starts from.
        parents: `(N,)` place in `order` of the pose that each step starts from; 0 for the first pose.
        steps: `(N - 1, 4, 4)` `T_parent_pose` of all poses but the first.
        covariances: `(N - 1, 6, 6)` of the same.
        rows: `(N - 1,)` the edges that say so.
    """

    order: IntArray
    parents: IntArray
    steps: FloatArray
    covariances: FloatArray
    rows: IntArray

    @property
    def is_chain(self) -> bool:
        """Whether each step starts from the pose before."""
        return bool((self.parents == np.maximum(np.arange(len(self.parents)) - 1, 0)).all())

    def poses(self, T_world_first: FloatArray) -> FloatArray:
        """`T_world_body (N, 4, 4)`."""
        return composed(self.parents, np.concatenate([T_world_first[None], self.steps]))


def odometry_tree(size: int, edges: EdgeTable) -> OdometryTree:
    """The odometry of a robot of `size` poses, which the edges connect.

    Edges between consecutive poses are odometry if nearly all of these pairs have one.  What they leave apart is
    joined by edges from which the guesses were made, then by those that a robust estimate over all edges agrees with
    best; loops that the file says may be false come last.
    """
    step = edges.is_step()
    steps = np.unique(np.minimum(edges.first, edges.second)[step])
    sure = step if len(steps) >= ODOMETRY_SHARE * (size - 1) else np.zeros(len(edges), bool)
    rank = np.where(sure, 0, np.where(edges.exact, 1, 2)) + 3 * edges.may_be_false
    kinds = edges.matrix_kinds()
    rare = -np.bincount(kinds, sure)[kinds]  # what few steps state is rather a loop's
    worth = np.where(edges.exact, 0.0, edges.chi_square)
    rows = _spanning_rows(size, edges, _order(edges, rank, ~edges.exact, rare, worth))
    if (rank[rows] > 1).any():
        worth = _robust_cost(size, edges, rows, rank < 2)
        rows = _spanning_rows(size, edges, _order(edges, rank, worth))
    return _rooted(size, edges, rows)


def _order(edges: EdgeTable, *keys: FloatArray | IntArray | BoolArray) -> IntArray:
    """Rows sorted by the keys, the first counting most; edges alike in all by what they state, not by their place."""
    canonical = edges.canonical_order()
    return canonical[np.lexsort([key[canonical] for key in reversed(keys)])]


def composed(parents: IntArray, steps: FloatArray) -> FloatArray:
    """Products `(N, 4, 4)` of all steps from the first to each, by pointer jumping: log N rounds."""
    poses, before = steps.copy(), parents.copy()
    poses[0] = np.eye(4)
    for _ in range(len(parents).bit_length()):
        poses, before = poses[before] @ poses, before[before]
    return np.asarray(steps[0] @ poses)


def _spanning_rows(size: int, edges: EdgeTable, preference: IntArray) -> IntArray:
    """Rows of the spanning tree that takes edges in the order of preference (Kruskal)."""
    ends = np.sort(np.stack([edges.first, edges.second], axis=1)[preference], axis=1)
    _, best = np.unique(ends, axis=0, return_index=True)
    best = best[ends[best, 0] != ends[best, 1]]
    weights = coo_array((best + 1.0, (ends[best, 0], ends[best, 1])), shape=(size, size)).tocsr()
    return preference[np.sort(minimum_spanning_tree(weights).data.astype(np.int64)) - 1]


def _rooted(size: int, edges: EdgeTable, rows: IntArray) -> OdometryTree:
    """The tree from its smallest number on, in the order of numbers as far as steps allow."""
    first, second = edges.first[rows], edges.second[rows]
    graph = coo_array((np.ones(2 * len(rows)), (np.r_[first, second], np.r_[second, first])), shape=(size, size))
    _, before = breadth_first_order(graph.tocsr(), 0, directed=False)
    before[0] = 0
    order = _parents_first(before.astype(np.int64))
    place = np.argsort(order)
    child = np.where(before[second] == first, second, first)
    by_place = np.argsort(place[child])
    rows, child = rows[by_place], child[by_place]
    T, covariance = edges.T[rows], edges.covariance[rows]
    turned = edges.second[rows] != child
    steps = np.where(turned[:, None, None], se3.inverse(T), T)
    covariances = np.where(turned[:, None, None], se3.inverse_covariance(T, covariance), covariance)
    return OdometryTree(order, np.r_[0, place[before[child]]], steps, covariances, rows)


def _parents_first(before: IntArray) -> IntArray:
    """The numbers in their order, but each after the one before it on the way from 0."""
    size = len(before)
    if (before[1:] < np.arange(1, size)).all():
        return np.arange(size)
    tree: nx.DiGraph[int] = nx.DiGraph(zip(before[1:].tolist(), range(1, size), strict=True))
    return np.fromiter(nx.lexicographical_topological_sort(tree), np.int64, size)


def _robust_cost(size: int, edges: EdgeTable, start_rows: IntArray, trusted: BoolArray) -> FloatArray:
    """How much each edge `(E,)` disagrees with a robust estimate over all of them.

    Geman-McClure's kernel forgets edges that are far off, but not a bad start, which is a spanning tree; Cauchy's finds
    from one to where most edges agree, but false ones still pull.  So it is tried with and without Cauchy's first.
    """
    tree = _rooted(size, edges, start_rows)
    start = gtsam.Values()
    for pose, T in zip(tree.order.tolist(), tree.poses(np.eye(4)), strict=True):
        start.insert(pose, gtsam.Pose3(T))
    forgetting = _robust_graph(edges, trusted, gtsam.noiseModel.mEstimator.GemanMcClure.Create(REACH))
    pulling = _robust_graph(edges, trusted, gtsam.noiseModel.mEstimator.Cauchy.Create(REACH))
    solutions = [_solved(forgetting, start), _solved(forgetting, _solved(pulling, start))]
    best = min(solutions, key=forgetting.error)
    return np.array([forgetting.at(n).error(best) for n in range(len(edges))])


def _robust_graph(
    edges: EdgeTable, trusted: BoolArray, kernel: gtsam.noiseModel.mEstimator.Base
) -> gtsam.NonlinearFactorGraph:
    """All edges, those not trusted with a kernel, then a prior that holds the first pose."""
    graph = gtsam.NonlinearFactorGraph()
    for n in range(len(edges)):
        stated = gtsam.noiseModel.Gaussian.Covariance(edges.covariance[n])
        noise = stated if trusted[n] else gtsam.noiseModel.Robust.Create(kernel, stated)
        ends = int(edges.first[n]), int(edges.second[n])
        graph.add(gtsam.BetweenFactorPose3(*ends, gtsam.Pose3(edges.T[n]), noise))
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)))
    return graph


def _solved(graph: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> gtsam.Values:
    try:
        return gtsam.LevenbergMarquardtOptimizer(graph, start).optimize()
    except RuntimeError:  # indeterminate: the start is all there is
        return start
