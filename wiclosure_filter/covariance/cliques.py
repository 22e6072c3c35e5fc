"""A pose graph's information matrix, eliminated in cliques of poses (GTSAM).

GTSAM eliminates the poses in a nested dissection order: `Lambda = R^T R` with R upper triangular and sparse, in a tree
of cliques.  Those that follow nearly the same later poses are joined to one *clique* with a dense block (supernodes:
Davis, Direct Methods for Sparse Linear Systems, 2006, section 4.7): its x_J follows its separator x_S as
`x_J = response x_S + remainder z_J`, with z independent and of one standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import gtsam
import numpy as np
from scipy.linalg.lapack import dtrtri

from wiclosure.types import FloatArray, IntArray

_FILLED = 0.8  # share of the blocks of what joins a clique that must not be zero
_FEW = 16  # poses with their separator: their zeros cost less than a clique of their own


@dataclass(frozen=True, eq=False)
class Clique:
    """k poses that are eliminated together, and the w later ones that they follow.

    Args:
        poses: `(k,)`.
        separator: `(w,)` poses of cliques above.
        response: `(6 k, 6 w)`.
        remainder: `(6 k, 6 k)`, upper triangular, column by column as BLAS has it.
        parent: number of the clique above; -1 at a root.
    """

    poses: IntArray
    separator: IntArray
    response: FloatArray
    remainder: FloatArray
    parent: int


@dataclass(frozen=True, eq=False)
class Eliminated:
    """A linearised graph of poses 0 ... K-1.

    Args:
        tree: of cliques, as GTSAM has them.
    """

    tree: gtsam.GaussianBayesTree

    @classmethod
    def of(cls, linear: gtsam.GaussianFactorGraph) -> Eliminated:
        """Eliminates all poses.

        Raises:
            numpy.linalg.LinAlgError: some pose is not determined.
        """
        try:
            return cls(linear.eliminateMultifrontal(gtsam.Ordering.MetisGaussianFactorGraph(linear)))
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error).strip().splitlines()[0]) from None

    def solution(self) -> FloatArray:
        """`(K, 6)` the poses' movements that solve the graph."""
        values = self.tree.optimize()
        return np.array([values.at(key) for key in range(values.size())])

    def cliques(self) -> list[Clique]:
        """Depth first, so that those above come first and neighbours near each other."""
        return [_clique(members, parent) for members, parent in _joined(self.tree)]


@dataclass(frozen=True, eq=False)
class _Member:
    """A clique of GTSAM's tree: k poses, then the w that they follow."""

    conditional: gtsam.GaussianConditional
    keys: IntArray
    k: int

    @classmethod
    def of(cls, clique: gtsam.GaussianBayesTreeClique) -> _Member:
        conditional = clique.conditional()
        return cls(conditional, np.array(conditional.keys(), np.int64), len(conditional.R()) // 6)


@dataclass(eq=False)
class _Growing:
    """A clique while others join it from below: members from the top, and cliques that stay on their own."""

    members: list[_Member]
    poses: int
    below: list[_Growing] = field(default_factory=list)

    def takes(self, member: _Member) -> bool:
        """Whether few blocks of the member's poses would be zero; what joins a clique does not widen its separator."""
        top = self.members[0]
        together = self.poses + member.k + len(top.keys) - top.k
        return together <= _FEW or len(member.keys) > _FILLED * together

    def add(self, member: _Member) -> None:
        """From below."""
        self.members.append(member)
        self.poses += member.k


def _joined(tree: gtsam.GaussianBayesTree) -> list[tuple[list[_Member], int]]:
    """Members of each clique in the order of elimination, and number of the clique above; cliques depth first."""
    roots: list[_Growing] = []
    cliques: list[tuple[gtsam.GaussianBayesTreeClique, _Growing | None]] = [(root, None) for root in tree.roots()]
    while cliques:
        clique, above = cliques.pop()
        member = _Member.of(clique)
        if above is not None and above.takes(member):
            above.add(member)
        else:
            own = _Growing([member], member.k)
            (roots if above is None else above.below).append(own)
            above = own
        cliques += [(clique[child], above) for child in range(clique.nrChildren())]
    order: list[tuple[list[_Member], int]] = []
    waiting = [(root, -1) for root in reversed(roots)]
    while waiting:
        grown, parent = waiting.pop()
        waiting += [(below, len(order)) for below in reversed(grown.below)]
        order.append((grown.members[::-1], parent))
    return order


def _clique(members: Sequence[_Member], parent: int) -> Clique:
    poses = np.concatenate([member.keys[: member.k] for member in members])
    separator = members[-1].keys[members[-1].k :]
    both = np.concatenate([poses, separator])
    order = np.argsort(both)
    rows, start = np.zeros((6 * len(poses), len(both), 6)), 0
    for member in members:
        columns = order[np.searchsorted(both, member.keys, sorter=order)]
        blocks = np.hstack([member.conditional.R(), member.conditional.S()])
        rows[6 * start : 6 * (start + member.k), columns] = blocks.reshape(6 * member.k, -1, 6)
        start += member.k
    dense, size = rows.reshape(6 * len(poses), -1), 6 * len(poses)
    remainder, singular = dtrtri(dense[:, :size])
    if singular:
        raise np.linalg.LinAlgError("a pose is not determined")
    return Clique(poses, separator, -remainder @ dense[:, size:], remainder, parent)
