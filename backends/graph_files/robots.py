"""Which poses are one robot's: those that its own edges connect."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, min_weight_full_bipartite_matching
from scipy.stats import chi2

from wiclosure.backends.graph_files.edge_table import EdgeTable
from wiclosure.types import BoolArray, IntArray

NEARLY_ALL = 0.9  # of the steps, or poses: what holds for so many is the rule, and the others are exceptions
CONTRADICTING_CHI_SQUARE = float(chi2.isf(1e-6, 6))
FAR_WORSE = 1e3  # times the misfit of the other steps, however wrong the stated sigmas are
FRAGMENTS = 10  # poses of a robot, on average; less say that the numbers do not follow the robots


def connected(size: int, edges: EdgeTable) -> IntArray:
    """Labels `(size,)`: poses of one name are one robot where edges join them."""
    return _components(size, edges.first, edges.second)


def by_own_edges(size: int, edges: EdgeTable) -> IntArray:
    """Labels `(size,)` of poses, in the order of their plain numbers, which nothing but their edges tells apart.

    1. Guesses that were made from edges, one after the other, tell odometry: these edges agree to the last digit, and
       loops do not.
    2. Else matrices do, where odometry states one and the same, and loops others.
    3. Else robots are chains of rising numbers: few that hold all poses, and whose leaps from number to number are
       those that most edges make.  A step to the next number that the guesses contradict, and no other, is none.  Where
       this leaves less than ten poses to a robot, numbers do not follow robots: all that is connected is one.
    """
    own = edges[~edges.may_be_false]
    labels = _from_guesses(size, own)
    if labels is None:
        labels = _from_matrices(size, own)
    if labels is None:
        labels = _from_chains(size, own[~_belies_its_neighbours(own)])
    return _with_strays(labels, edges)


def _components(size: int, first: IntArray, second: IntArray) -> IntArray:
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _pairs(edges: EdgeTable) -> IntArray:
    """`(P, 2)` different pairs of poses that edges join, the smaller number first."""
    pairs = np.sort(np.stack([edges.first, edges.second], axis=1), axis=1)
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)


def _hold_like_odometry(size: int, edges: EdgeTable) -> bool:
    """Whether these edges close no loop and reach nearly all poses."""
    pairs = _pairs(edges)
    trees = _components(size, *pairs.T)
    reached = np.bincount(trees)[trees] > 1
    return len(pairs) == size - len(np.unique(trees)) and bool(reached.mean() >= NEARLY_ALL)


def _from_guesses(size: int, edges: EdgeTable) -> IntArray | None:
    """Trees of edges from which the guesses were made; None if they were made otherwise."""
    inexact = edges.is_step() & ~edges.exact & (edges.chi_square < CONTRADICTING_CHI_SQUARE)
    exceptions = len(_pairs(edges[inexact])) / max(len(_pairs(edges[edges.exact])), 1)
    if exceptions > 1 - NEARLY_ALL or not _hold_like_odometry(size, edges[edges.exact]):
        return None
    nearly = edges[edges.exact | (edges.is_step() & (edges.misfit < FAR_WORSE))]  # a step that was written otherwise
    return _components(size, nearly.first, nearly.second)


def _from_matrices(size: int, edges: EdgeTable) -> IntArray | None:
    """Trees of the edges that state the most frequent matrix; None if these are no odometry.

    Steps to the next number that agree with the guesses belong to them, unless they state what loops do.
    """
    if not len(edges):
        return None
    kind = edges.matrix_kinds()
    usual = kind == np.argmax(np.bincount(kind))
    if not _hold_like_odometry(size, edges[usual]):
        return None
    loops = kind[~edges.is_step() & ~usual]
    of_loops = kind == (np.argmax(np.bincount(loops)) if len(loops) else -1)
    agreeing = edges.chi_square < CONTRADICTING_CHI_SQUARE
    telling = agreeing[usual].mean() >= NEARLY_ALL  # guesses that contradict odometry itself tell nothing
    step = edges.is_step() & (agreeing if telling else True) & ~of_loops
    odometry = edges[usual | step]
    return _components(size, odometry.first, odometry.second)


def _belies_its_neighbours(edges: EdgeTable) -> BoolArray:
    """Steps that are none: closures between the last pose of one robot and the first of the next."""
    step = edges.is_step()
    if step.sum() < 3:
        return np.zeros(len(edges), bool)
    usual = float(np.quantile(edges.chi_square[step], NEARLY_ALL, method="lower"))
    return np.asarray(step & (edges.chi_square > max(CONTRADICTING_CHI_SQUARE, FAR_WORSE * usual)))


def _from_chains(size: int, edges: EdgeTable) -> IntArray:
    """Path cover of least cost, by bipartite matching; an end of a chain costs as much as the two rarest leaps."""
    first, second = _pairs(edges).T
    everyone = np.arange(size)
    leap = second - first
    cost = 1.0 + np.log(len(leap) / np.bincount(leap)[leap])  # of leaps that few edges make
    cost = np.concatenate([cost, np.full(size, 2.0 * cost.max(initial=1.0))])
    ends = np.concatenate([first, everyone]), np.concatenate([second, size + everyone])
    left, right = min_weight_full_bipartite_matching(coo_array((cost, ends), shape=(size, 2 * size)).tocsr())
    followed = right < size
    labels = _components(size, everyone[left[followed]], everyone[right[followed]])
    everything = _components(size, first, second)
    return everything if size < FRAGMENTS * (labels.max() + 1) else labels


def _with_strays(labels: IntArray, edges: EdgeTable) -> IntArray:
    """Single poses that edges join to one robot alone are its own: one pose is no robot."""
    joined, single = labels.copy(), np.bincount(labels)[labels] == 1
    ends = np.concatenate([np.stack([edges.first, edges.second]), np.stack([edges.second, edges.first])], axis=1)
    ends = ends[:, single[ends[0]] & (ends[0] != ends[1])]
    for stray in np.unique(ends[0]):
        robots = np.unique(labels[ends[1, ends[0] == stray]])
        if len(robots) == 1 and not single[labels == robots[0]].any():
            joined[stray] = robots[0]
    return joined
