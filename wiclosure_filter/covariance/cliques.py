"""A pose graph's information matrix, eliminated in cliques of poses (GTSAM).

GTSAM eliminates the poses in a nested dissection order: `Lambda = R^T R` with R upper triangular and sparse.  Poses
that follow nearly the same later ones are taken together, as a *clique* with a dense block (supernodes: Davis, Direct
Methods for Sparse Linear Systems, 2006, section 4.7): its x_J follows its separator x_S as
`x_J = response x_S + remainder z_J`, with z independent and of one standard deviation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from scipy.linalg import solve_triangular

from wiclosure.types import FloatArray, IntArray

_FILLED = 0.8  # share of a pose's blocks in a clique that must not be zero
_FEW = 16  # poses with their separator: their zeros cost less than a clique of their own


@dataclass(frozen=True, eq=False)
class Clique:
    """k poses that are eliminated together, and the w later ones that they follow.

    Args:
        poses: `(k,)`.
        separator: `(w,)` poses of cliques above.
        response: `(6 k, 6 w)`.
        remainder: `(6 k, 6 k)`, upper triangular.
        parent: number of the clique above; -1 at a root.
    """

    poses: IntArray
    separator: IntArray
    response: FloatArray
    remainder: FloatArray
    parent: int


@dataclass(frozen=True, eq=False)
class Eliminated:
    """A linearised graph of K poses.

    Args:
        cliques: depth first, so that those above come first and neighbours near each other.
        solution: `(K, 6)` the poses' movements that solve it.
    """

    cliques: Sequence[Clique]
    solution: FloatArray


def eliminate(linear: gtsam.GaussianFactorGraph) -> Eliminated:
    """Eliminates poses 0 ... K-1.

    Raises:
        numpy.linalg.LinAlgError: some pose is not determined.
    """
    try:
        net = linear.eliminateSequential(gtsam.Ordering.MetisGaussianFactorGraph(linear))
    except RuntimeError as error:
        raise np.linalg.LinAlgError(str(error).strip().splitlines()[0]) from None
    solution, size = net.optimize(), net.size()
    conditionals = [net.at(size - 1 - place) for place in range(size)]
    keys = [np.array(conditional.keys(), np.int64) for conditional in conditionals]
    cliques = []
    for places, parent in _grouped(keys):
        own = [keys[place] for place in places]
        cliques.append(_clique([conditionals[place] for place in places], own, parent))
    return Eliminated(cliques, np.array([solution.at(key) for key in range(size)]))


def _clique(conditionals: Sequence[gtsam.GaussianConditional], keys: Sequence[IntArray], parent: int) -> Clique:
    """Of conditionals in the order of elimination, with the keys of each."""
    poses, separator = np.array([own[0] for own in keys]), keys[-1][1:]
    both = np.concatenate([poses, separator])
    order = np.argsort(both)
    rows = np.zeros((len(poses), 6, len(both), 6))
    for row, (conditional, own) in enumerate(zip(conditionals, keys, strict=True)):
        rows[row, :, row] = conditional.R()
        rows[row][:, order[np.searchsorted(both, own[1:], sorter=order)]] = conditional.S().reshape(6, -1, 6)
    dense, size = rows.reshape(6 * len(poses), -1), 6 * len(poses)
    remainder = np.asarray(solve_triangular(dense[:, :size], np.eye(size), check_finite=False))
    return Clique(poses, separator, -remainder @ dense[:, size:], remainder, parent)


def _grouped(keys: Sequence[IntArray]) -> list[tuple[list[int], int]]:
    """Places of each clique, in the order of elimination, and number of the clique above; cliques depth first.

    A pose's separator lies in that of its nearest ancestor, but for this one: those that join a clique do not widen it.

    Args:
        keys: of the pose of each place, itself and what it depends on; places are the reverse order of elimination.
    """
    place = np.empty(len(keys), np.int64)
    place[[own[0] for own in keys]] = np.arange(len(keys))
    members: list[list[int]] = []
    children: list[list[int]] = []
    roots: list[int] = []
    clique_of = np.empty(len(keys), np.int64)
    for number, own in enumerate(keys):
        above = int(clique_of[place[own[1:]].max()]) if len(own) > 1 else -1
        together = len(members[above]) + len(keys[members[above][0]]) if above >= 0 else 0
        if above >= 0 and (together <= _FEW or len(own) > _FILLED * together):
            members[above].append(number)
            clique_of[number] = above
            continue
        clique_of[number] = len(members)
        (children[above] if above >= 0 else roots).append(len(members))
        members.append([number])
        children.append([])
    order: list[tuple[list[int], int]] = []
    waiting = [(root, -1) for root in reversed(roots)]
    while waiting:
        clique, parent = waiting.pop()
        waiting += [(child, len(order)) for child in reversed(children[clique])]
        order.append((members[clique][::-1], parent))
    return order
