"""Sets of closures in which most agree with most: what a maximum clique is relaxed to.

A clique demands that all n (n - 1) / 2 pairs pass a test that a true pair fails now and then, so that large cliques of
true closures do not exist.  Here a closure belongs to a set if it agrees with half of its members at least; one whose
own noise is so large that it does not is one in thousands, and an unrelated one agrees with next to none.
"""

from __future__ import annotations

import numpy as np

from wiclosure.types import BoolArray, FloatArray, IntArray

ROUNDS = 20
SEEDS = 5  # best connected closures from which a set is grown


def dense_sets(agree: BoolArray, most: int) -> list[IntArray]:
    """Up to `most` sets, each grown among those that the sets before have left, largest first.

    Args:
        agree: `(N, N)` symmetric.
        most: number of sets.
    """
    counted, found = agree.astype(float), []  # BLAS counts votes, which are whole numbers
    np.fill_diagonal(counted, 0.0)
    for _ in range(most):
        members = _grown(counted)
        if len(members) < 1:
            break
        found.append(members)
        counted[members], counted[:, members] = 0.0, 0.0
    return found


def _grown(agree: FloatArray) -> IntArray:
    """The largest of the sets grown from the closures that agree with most others."""
    degree = agree.sum(axis=1)
    best = np.zeros(0, np.int64)
    if not degree.any():
        return best
    for seed in np.argsort(-degree, kind="stable")[:SEEDS]:
        members = _settled(agree, (agree[seed] > 0) | (np.arange(len(agree)) == seed))
        if members.sum() > len(best):
            best = np.flatnonzero(members)
    return best


def _settled(agree: FloatArray, members: BoolArray) -> BoolArray:
    """Members voted in and out until nothing changes."""
    for _ in range(ROUNDS):
        votes = agree @ members.astype(float)
        voters = members.sum() - members  # nobody votes on itself
        new = votes >= 0.5 * voters
        new &= votes > 0
        if (new == members).all():
            break
        members = new
    return members
