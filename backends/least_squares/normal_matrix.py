"""Normal matrices of least squares over nodes of a few degrees of freedom: sparse, ordered once, factorised often."""

from __future__ import annotations

from dataclasses import dataclass

import gtsam
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import SuperLU, splu

from wiclosure.types import FloatArray, IntArray

HELD = 1e12  # information of a pose that is held
LEAST_INFORMATION = 1e-9  # of any other: the matrix stays regular where nothing fixes the gauge


@dataclass(frozen=True, eq=False)
class Factorised:
    """A normal matrix, factorised: solves for any right-hand side."""

    of: SuperLU
    position: IntArray

    def solve(self, right: FloatArray) -> FloatArray:
        """`(N, K, ...)` for `(N, K, ...)`."""
        ordered = np.empty_like(right)
        ordered[self.position] = right
        solved = self.of.solve(ordered.reshape(right.shape[0] * right.shape[1], -1)).reshape(right.shape)
        return np.asarray(solved[self.position])


@dataclass(frozen=True, eq=False)
class NormalMatrix:
    """The pattern of the normal matrix of edges `(M,)` between N nodes.

    Args:
        position: `(N,)` place of each node in the order of elimination: nested dissection, by METIS.
        order: `(4 M,)` of the edges' blocks by column and row of the ordered matrix.
        starts: in that order, where the blocks of one place begin.
        indices, pointers: of the compressed rows.
        ends: `(N, M)` matrices, one at each edge's first and at its second node.
    """

    position: IntArray
    order: IntArray
    starts: IntArray
    indices: IntArray
    pointers: IntArray
    ends: tuple[sp.csr_matrix, sp.csr_matrix]

    @classmethod
    def of(cls, first: IntArray, second: IntArray, size: int) -> NormalMatrix:
        """Of edges between the nodes `first` and `second` of `size`."""
        position = elimination_positions(first, second, size)
        i, j = position[first], position[second]
        rows, columns = np.concatenate([i, i, j, j]), np.concatenate([i, j, i, j])
        order = np.argsort(rows * size + columns, kind="stable")
        places = (rows * size + columns)[order]
        starts = np.flatnonzero(np.diff(places, prepend=-1))
        pointers = np.searchsorted(places[starts] // size, np.arange(size + 1))
        count = len(first)
        ends = [sp.csr_matrix((np.ones(count), (of, np.arange(count))), shape=(size, count)) for of in (first, second)]
        return cls(position, order, starts, places[starts] % size, pointers, (ends[0], ends[1]))

    def factorised(
        self, A: FloatArray, B: FloatArray, weights: FloatArray, held: IntArray, damping: float
    ) -> Factorised:
        """Of whitened derivatives `(M, K, K)` by both ends of the edges, weighted `(M,)`.

        Args:
            A: derivatives by the first end.
            B: by the second.
            weights: of the edges.
            held: nodes that do not move.
            damping: share of the diagonal that is added to it.
        """
        At, Bt = (np.swapaxes(weights[:, None, None] * J, 1, 2) for J in (A, B))
        size, width = len(self.position), A.shape[-1]
        shape = (width * size, width * size)
        if len(self.order):
            blocks = np.concatenate([At @ A, At @ B, Bt @ A, Bt @ B])[self.order]
            summed = np.add.reduceat(blocks, self.starts, axis=0)
            H = sp.bsr_matrix((summed, self.indices, self.pointers), shape=shape).tocsc()
        else:
            H = sp.csc_matrix(shape)
        added = np.full((size, width), LEAST_INFORMATION)
        added[self.position[held]] = HELD
        H = H + sp.diags(added.ravel() + damping * H.diagonal())
        of = splu(H.tocsc(), permc_spec="NATURAL", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        return Factorised(of, self.position)

    def gathered(self, at_first: FloatArray, at_second: FloatArray) -> FloatArray:
        """Sums `(N, K, ...)` at the nodes of what the edges `(M, K, ...)` have at either end."""
        count, *shape = at_first.shape
        width = int(np.prod(shape))
        summed = sum(of @ at.reshape(count, width) for of, at in zip(self.ends, (at_first, at_second), strict=True))
        return np.asarray(summed).reshape(-1, *shape)


def elimination_positions(first: IntArray, second: IntArray, size: int) -> IntArray:
    """`(N,)` place of each node in an order of elimination that leaves the factors sparse."""
    position = np.full(size, -1)
    graph = gtsam.SymbolicFactorGraph()
    for i, j in np.unique(np.stack([first, second], axis=1), axis=0).tolist():
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
