"""Which poses are one robot's: those that its own edges connect."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components, min_weight_full_bipartite_matching
from scipy.stats import chi2

from wiclosure.backends.graph_files.edge_table import EdgeTable
from wiclosure.types import BoolArray, IntArray

NEARLY_ALL = 0.9  # of the steps, or poses: what holds for so many is the rule, and the others are exceptions
CONTRADICTION = float(chi2.isf(1e-6, 6))
FAR_WORSE = 1e3  # times the chi-square of the other steps, however wrong the stated sigmas are
FRAGMENTS = 10  # poses of a robot, on average; less say that the numbers do not follow the robots


def connected(size: int, edges: EdgeTable) -> IntArray:
    """Labels `(size,)`: poses of one name are one robot where edges join them."""
    return _components(size, edges.first, edges.second)


def by_own_edges(size: int, edges: EdgeTable) -> IntArray:
    """Labels `(size,)` of poses, in the order of their plain numbers, which nothing but their edges tells apart.

    1. Guesses that were made from edges, one after the other, tell odometry: these edges agree to the last digit, and
       loops do not.
    2. Else, where most poses have an edge to the next number, robots are runs of such steps.  A step ends a run if the
       guesses contradict it and no other, or if it states the matrix of the loops instead of that of the steps.
    3. Else numbers are interleaved: the fewest chains of rising numbers that hold all poses, of those the ones with the
       smallest leaps.

    Where 2 or 3 leave less than ten poses to a robot, numbers do not follow robots: all that is connected is one.
    """
    own = edges[~edges.may_be_false]
    labels = _from_guesses(size, own)
    if labels is None:
        labels = _from_runs(size, own)
    if labels is None:
        labels = _from_chains(size, own)
    return _with_strays(labels, edges)


def _components(size: int, first: IntArray, second: IntArray) -> IntArray:
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(size, size))
    return np.asarray(connected_components(graph, directed=False)[1], np.int64)


def _pairs(edges: EdgeTable) -> IntArray:
    """`(P, 2)` different pairs of poses that edges join, the smaller number first."""
    pairs = np.sort(np.stack([edges.first, edges.second], axis=1), axis=1)
    return np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)


def _from_guesses(size: int, edges: EdgeTable) -> IntArray | None:
    """Trees of edges from which the guesses were made; None if they were made otherwise."""
    exact = _pairs(edges[edges.exact])
    labels = _components(size, *exact.T)
    forest = len(exact) == size - len(np.unique(labels))
    covered = np.bincount(labels)[labels] > 1
    exceptions = len(_pairs(edges[edges.is_step() & ~edges.exact]))
    chained = forest and covered.mean() >= NEARLY_ALL and exceptions <= (1 - NEARLY_ALL) * len(exact)
    return labels if chained else None


def _from_runs(size: int, edges: EdgeTable) -> IntArray | None:
    """Runs of consecutive numbers; None where less than half of the poses have an edge to the next."""
    steps = edges[edges.is_step() & ~_belies_its_neighbours(edges)]
    pairs = _pairs(steps)
    return _unless_in_pieces(_components(size, *pairs.T), edges) if 2 * len(pairs) >= size - 1 else None


def _belies_its_neighbours(edges: EdgeTable) -> BoolArray:
    """Steps that are none: closures between the last pose of one robot and the first of the next."""
    step = edges.is_step()
    if step.sum() < 3:
        return np.zeros(len(edges), bool)
    usual = float(np.quantile(edges.chi_square[step], NEARLY_ALL, method="lower"))
    if usual < CONTRADICTION:
        return np.asarray(step & (edges.chi_square > max(CONTRADICTION, FAR_WORSE * usual)))
    return step & _states_what_loops_state(edges, step)


def _states_what_loops_state(edges: EdgeTable, step: BoolArray) -> BoolArray:
    """Where nearly all steps state one matrix and the loops another: which edges state that of the loops."""
    _, kind = np.unique(edges.covariance.reshape(len(edges), -1).round(12), axis=0, return_inverse=True)
    counts = [np.bincount(kind[of], minlength=kind.max() + 1) for of in (step, ~step)]
    usual = [int(np.argmax(count)) for count in counts]
    ruled = step.any() and not step.all() and counts[0][usual[0]] >= NEARLY_ALL * step.sum()
    return np.asarray((kind == usual[1]) & bool(ruled and usual[0] != usual[1]))


def _from_chains(size: int, edges: EdgeTable) -> IntArray:
    """Minimum path cover, by bipartite matching."""
    first, second = _pairs(edges).T
    everyone = np.arange(size)
    leap = np.concatenate([second - first, np.full(size, size + 1)]).astype(float)
    ends = np.concatenate([first, everyone]), np.concatenate([second, size + everyone])
    left, right = min_weight_full_bipartite_matching(coo_array((leap, ends), shape=(size, 2 * size)).tocsr())
    followed = right < size
    return _unless_in_pieces(_components(size, everyone[left[followed]], everyone[right[followed]]), edges)


def _unless_in_pieces(labels: IntArray, edges: EdgeTable) -> IntArray:
    """The labels, or all that edges connect as one robot where there are few poses a label."""
    all_connected = _components(len(labels), edges.first, edges.second)
    return all_connected if len(labels) < FRAGMENTS * (labels.max() + 1) else labels


def _with_strays(labels: IntArray, edges: EdgeTable) -> IntArray:
    """Single poses that edges join to one robot alone are its own: one pose is no robot."""
    labels = labels.copy()
    single = np.bincount(labels)[labels] == 1
    for pose, other in ((edges.first, edges.second), (edges.second, edges.first)):
        rows = single[pose] & ~single[other]
        for stray in np.unique(pose[rows]):
            ends = np.concatenate([edges.second[edges.first == stray], edges.first[edges.second == stray]])
            joined = np.unique(labels[ends[ends != stray]])
            if len(joined) == 1:
                labels[stray] = joined[0]
    return labels
