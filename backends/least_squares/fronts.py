"""In what order a sparse symmetric matrix is eliminated, and which nodes at once: fronts, each a small dense matrix.

Duff and Reid, "The multifrontal solution of indefinite sparse symmetric linear equations", TOMS 1983; order by nested
dissection (METIS), elimination tree by Liu (SIAM J. Matrix Anal. Appl. 1990), fronts merged as in Ashcraft and Grimes
(TOMS 1989).
"""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np

from wiclosure.types import IntArray

FEW_NODES = 24  # that one front takes at once, whatever is zero: small dense matrices cost nothing
MOST_ZEROS = 0.2  # share of a larger front's columns that may be zero


@dataclass(frozen=True, eq=False)
class Front:
    """Nodes `start .. stop - 1` of the order, eliminated at once.

    Args:
        start, stop: of the nodes.
        rest: `(K,)` later nodes, sorted, that these are joined with once all earlier ones are gone.
        parent: place in the list of fronts of the one that takes what is left; -1 where nothing is.
    """

    start: int
    stop: int
    rest: IntArray
    parent: int


def elimination_positions(first: IntArray, second: IntArray, size: int) -> IntArray:
    """`(N,)` place of each node in an order of elimination that leaves the factors sparse."""
    position = np.full(size, -1)
    graph = gtsam.SymbolicFactorGraph()
    joined = np.unique(first * size + second)
    for i, j in zip((joined // size).tolist(), (joined % size).tolist(), strict=True):
        graph.push_factor(i, j)
    if graph.size():
        ordering = gtsam.Ordering.MetisSymbolicFactorGraph(graph)
        if not ordering.size():  # now and then METIS fails, on dense graphs, and gives nothing
            ordering = gtsam.Ordering.ColamdSymbolicFactorGraph(graph)
        eliminated = np.array([ordering.at(n) for n in range(ordering.size())])
        position[eliminated] = np.arange(len(eliminated))
    alone = np.flatnonzero(position < 0)
    position[alone] = size - len(alone) + np.arange(len(alone))
    return position


def fronts_of(first: IntArray, second: IntArray, size: int) -> tuple[IntArray, list[Front]]:
    """`(N,)` place of each node, and the fronts, children before parents, for edges `(M,)` between N nodes."""
    position = elimination_positions(first, second, size)
    low, high = _sorted_ends(position[first], position[second])
    parent = _elimination_tree(low, high, size)
    order = _postorder(parent)
    place = np.empty(size, np.int64)
    place[order] = np.arange(size)
    position = place[position]
    low, high = _sorted_ends(position[first], position[second])
    parent = np.where(parent[order] < 0, -1, place[parent[order]])
    return position, _merged_fronts(low, high, parent)


def _sorted_ends(one: IntArray, other: IntArray) -> tuple[IntArray, IntArray]:
    return np.minimum(one, other), np.maximum(one, other)


def _elimination_tree(low: IntArray, high: IntArray, size: int) -> IntArray:
    """`(N,)` the first later node that each is joined with once all before are gone; -1 at roots."""
    parent, ancestor = [-1] * size, [-1] * size
    by_high = np.lexsort((low, high))
    for below, later in zip(low[by_high].tolist(), high[by_high].tolist(), strict=True):
        node = below
        while node != later:
            above, ancestor[node] = ancestor[node], later  # paths are compressed
            if above < 0:
                parent[node] = later
                break
            node = above
    return np.array(parent, np.int64)


def _postorder(parent: IntArray) -> IntArray:
    """Nodes `(N,)` such that those below each come right before it."""
    last, before = [-1] * (len(parent) + 1), [-1] * len(parent)  # child of each, of none at the end; sibling of each
    for node, above in enumerate(parent.tolist()):
        before[node], last[above] = last[above], node
    order, waiting = [], [last[-1]]
    while waiting:
        node = waiting.pop()
        if node >= 0:
            order.append(node)
            waiting += before[node], last[node]
    return np.array(order[::-1], np.int64)


def _merged_fronts(low: IntArray, high: IntArray, parent: IntArray) -> list[Front]:
    """Of nodes in postorder: whole subtrees of a few nodes; above these, parents with the child right before them."""
    size = len(parent)
    below = np.ones(size, np.int64)  # nodes of each subtree
    for node, above in enumerate(parent.tolist()):
        if above >= 0:
            below[above] += below[node]
    small = below <= FEW_NODES
    tops = np.flatnonzero(small & ((parent < 0) | ~small[parent]))
    firsts = np.arange(size) - below + 1
    begin = {int(firsts[top]): int(top) for top in tops}
    by_low = np.argsort(low, kind="stable")
    joined, bounds = high[by_low], np.searchsorted(low[by_low], np.arange(size + 1))
    found: list[_Growing] = []
    waiting: dict[int, list[IntArray]] = {}  # by parent node, what the fronts below it leave
    node = 0
    while node < size:
        last = begin.get(node, node)
        rest = np.unique(np.concatenate([joined[bounds[node] : bounds[last + 1]], *waiting.pop(last, [])]))
        rest = rest[np.searchsorted(rest, last, side="right") :]
        before = found[-1] if found else None
        if before is not None and last == node and before.takes(node, rest, int(parent[before.stop - 1])):
            before.add(node, rest)
        else:
            before = _Growing(node, last + 1, rest)
            found.append(before)
        if len(rest):
            waiting.setdefault(int(rest[0]), []).append(rest)
        node = last + 1
    front_of = np.repeat(np.arange(len(found)), [front.stop - front.start for front in found])
    return [
        Front(front.start, front.stop, front.rest, int(front_of[front.rest[0]]) if len(front.rest) else -1)
        for front in found
    ]


@dataclass(eq=False)
class _Growing:
    """A front while nodes join it."""

    start: int
    stop: int
    rest: IntArray
    zeros: int = 0

    def takes(self, node: int, rest: IntArray, parent: int) -> bool:
        """Whether the node's columns would hold few zeros."""
        if parent != node:
            return False
        columns, zeros = self.stop - self.start + 1, self.zeros + self._added(rest)
        return columns + len(rest) <= 2 * FEW_NODES or zeros <= MOST_ZEROS * columns * (columns + len(rest))

    def add(self, node: int, rest: IntArray) -> None:
        """The node right after the others."""
        self.zeros += self._added(rest)
        self.stop, self.rest = node + 1, rest

    def _added(self, rest: IntArray) -> int:
        """Zeros in the columns so far, where a node with this rest joins them."""
        return (self.stop - self.start) * (len(rest) + 1 - len(self.rest))
