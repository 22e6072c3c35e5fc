"""Sparse square root of a pose graph's information matrix, and what is asked of its inverse.

The covariance is `Lambda^-1 = R^-1 R^-T`: with the rows V of R^-1, poses n and m have the covariance `V_n V_m^T`.  A
pose's row has numbers only where its own clique and those above it stand (Davis, Direct Methods for Sparse Linear
Systems, 2006, section 3), of which a graph that lies in a plan has few; those of two poses are the same from the root
down to where their ways part.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.covariance.cliques import Clique, Eliminated
from wiclosure.wiclosure_filter.covariance.recent import Recent

MOST_BYTES = 1 << 29  # of rows that are kept: what robots share that lie near each other


@dataclass(frozen=True, eq=False)
class SquareRoot:
    """Of the information of K poses.

    Args:
        cliques: depth first, so that those above come first and neighbours near each other.
        clique_of: `(K,)` number of each pose's clique.
        slot: `(K,)` number of each pose in its clique.
    """

    cliques: Sequence[Clique]
    clique_of: IntArray
    slot: IntArray
    _known: Recent[FloatArray] = field(default_factory=lambda: Recent(MOST_BYTES), repr=False)

    @classmethod
    def of(cls, eliminated: Eliminated) -> SquareRoot:
        """Of a graph's elimination."""
        cliques = eliminated.cliques()
        size = sum(len(clique.poses) for clique in cliques)
        clique_of, slot = (np.empty(size, np.int64) for _ in range(2))
        for number, clique in enumerate(cliques):
            clique_of[clique.poses], slot[clique.poses] = number, np.arange(len(clique.poses))
        return cls(cliques, clique_of, slot)

    def rows(self, poses: IntArray, parts: FloatArray) -> tuple[FloatArray, IntArray]:
        """Rows of R^-1, as columns: how poses depend on the independent z.

        Args:
            poses: `(P,)`.
            parts: `(P, d, 6)` what is asked of each of them.

        Returns:
            Values `(6 C, P, d)`, and the cliques, increasing, whose C poses their rows belong to, in order.
        """
        cliques = self.with_ancestors(poses)
        above = {self.cliques[number].parent for number in cliques.tolist()}
        ends = 6 * np.cumsum(self.lengths(cliques))
        values = np.zeros((ends[-1], len(poses), parts.shape[1]))
        columns: dict[int, IntArray] = {-1: np.zeros(0, np.int64)}  # of a clique and those above it
        for number, end in zip(cliques.tolist(), ends.tolist(), strict=True):
            clique = self.cliques[number]
            columns[number] = np.append(columns[clique.parent], np.arange(end - len(clique.remainder), end))
            asked = np.flatnonzero(self.clique_of[poses] == number)
            if len(asked) == 0:
                continue
            of_poses = np.zeros((len(asked), parts.shape[1], len(clique.poses), 6))
            of_poses[np.arange(len(asked)), :, self.slot[poses[asked]]] = parts[asked]
            wanted = of_poses.reshape(-1, len(clique.remainder))
            if number in above:
                found = wanted @ self._known_rows(number)
            else:
                found = np.hstack([(wanted @ clique.response) @ self._above(clique), wanted @ clique.remainder])
            values[columns[number][:, None], asked] = found.T.reshape(-1, len(asked), parts.shape[1])
        self._known.forget(n for n in cliques[::-1].tolist() if n in above)  # those above are shared, and kept longer
        return values, cliques

    def _known_rows(self, number: int) -> FloatArray:
        """Rows `(6 k, 6 L)` of R^-1 of a clique, over the L poses of the cliques above it and of itself."""
        if number not in self._known:
            clique = self.cliques[number]
            rows = np.hstack([clique.response @ self._above(clique), clique.remainder])
            self._known.add(number, rows, rows.nbytes)
        return self._known[number]

    def _above(self, clique: Clique) -> FloatArray:
        """Rows `(6 w, 6 L)` of R^-1 of a clique's separator, over the poses of all cliques above it."""
        if clique.parent < 0:
            return np.zeros((0, 0))
        length = self._known_rows(clique.parent).shape[1]
        above = np.zeros((len(clique.separator), 6, length))
        numbers = self.clique_of[clique.separator]
        for number in np.unique(numbers).tolist():
            there = numbers == number
            rows = self._known_rows(number)
            above[there, :, : rows.shape[1]] = rows.reshape(-1, 6, rows.shape[1])[self.slot[clique.separator[there]]]
        return above.reshape(-1, length)

    def with_one(self, poses: IntArray, one: int) -> FloatArray:
        """Covariances `(P, 6, 6)` of poses with one pose: a column of the inverse, by two sparse substitutions."""
        cliques = self.with_ancestors(np.append(poses, one))
        at, ends = self._positions(cliques)
        found = np.zeros((ends[-1], 6, 6))
        found[at[one]] = np.eye(6)
        above = set(self.with_ancestors(np.array([one])).tolist())
        for number, end in zip(cliques[::-1].tolist(), ends[::-1].tolist(), strict=True):
            if number in above:  # what a pose follows is pulled with it
                clique = self.cliques[number]
                own = found[end - len(clique.poses) : end]
                found[at[clique.separator]] += (clique.response.T @ own.reshape(-1, 6)).reshape(-1, 6, 6)
                own[:] = (clique.remainder.T @ own.reshape(-1, 6)).reshape(own.shape)
        for number, end in zip(cliques.tolist(), ends.tolist(), strict=True):
            clique = self.cliques[number]
            own = found[end - len(clique.poses) : end]
            moved = clique.remainder @ own.reshape(-1, 6) if number in above else 0.0
            own[:] = (moved + clique.response @ found[at[clique.separator]].reshape(-1, 6)).reshape(own.shape)
        return found[at[poses]]

    def near(self, n: IntArray, m: IntArray) -> tuple[FloatArray, FloatArray]:
        """Covariance `(K, 6, 6)` of each pose, and `(M, 6, 6)` of poses n with m: NaN where neither follows the other.

        Those that a factor joins follow one another.  With the covariance of all that a clique follows known, its own
        comes of it (Takahashi et al., Formation of a sparse bus impedance matrix, 1973): what it follows is in the
        clique above, or followed by that.
        """
        size = len(self.clique_of)
        own, cross = np.zeros((size, 6, 6)), np.full((len(n), 6, 6), np.nan)
        last = np.maximum(self.clique_of[n], self.clique_of[m])
        order = np.argsort(last, kind="stable")
        bounds = np.searchsorted(last[order], np.arange(len(self.cliques) + 1))
        at = np.full(size, -1)
        fronts: dict[int, tuple[IntArray, FloatArray]] = {}  # on the way down to a clique
        for number, clique in enumerate(self.cliques):
            while fronts and next(reversed(fronts)) != clique.parent:
                fronts.popitem()
            both, front = _front(clique, *fronts.get(clique.parent, (clique.separator, np.zeros((0, 0, 6, 6)))))
            fronts[number] = both, front
            rows = np.arange(len(clique.poses))
            own[clique.poses] = front[rows, rows]
            at[both] = np.arange(len(both))
            pairs = order[bounds[number] : bounds[number + 1]]
            pairs = pairs[(at[n[pairs]] >= 0) & (at[m[pairs]] >= 0)]
            cross[pairs] = front[at[n[pairs]], at[m[pairs]]]
            at[both] = -1
        return own, cross

    def with_ancestors(self, poses: IntArray) -> IntArray:
        """Cliques of poses and all above them, increasing."""
        found: set[int] = set()
        for own in np.unique(self.clique_of[poses]).tolist():
            number = own
            while number >= 0 and number not in found:
                found.add(number)
                number = self.cliques[number].parent
        return np.array(sorted(found), np.int64)

    def lengths(self, cliques: IntArray) -> IntArray:
        """How many poses cliques have."""
        return np.array([len(self.cliques[number].poses) for number in cliques.tolist()], np.int64)

    def _poses(self, cliques: IntArray) -> IntArray:
        return np.concatenate([self.cliques[number].poses for number in cliques.tolist()])

    def _positions(self, cliques: IntArray) -> tuple[IntArray, IntArray]:
        """Where each pose of some cliques stands among them (others: anywhere), and where each clique ends."""
        poses, at = self._poses(cliques), np.empty(len(self.clique_of), np.int64)
        at[poses] = np.arange(len(poses))
        return at, np.cumsum(self.lengths(cliques))


def _front(clique: Clique, above: IntArray, covariance: FloatArray) -> tuple[IntArray, FloatArray]:
    """Poses of a clique and its separator, and their covariance `(n, n, 6, 6)`, from that of the clique above."""
    k, w = len(clique.poses), len(clique.separator)
    order = np.argsort(above)
    wanted = order[np.searchsorted(above, clique.separator, sorter=order)]
    front = np.empty((k + w, 6, k + w, 6))
    known = covariance[wanted[:, None], wanted].swapaxes(1, 2)
    cross = clique.response @ known.reshape(6 * w, 6 * w)
    front[k:, :, k:] = known
    front[:k, :, k:] = cross.reshape(k, 6, w, 6)
    front[k:, :, :k] = cross.T.reshape(w, 6, k, 6)
    front[:k, :, :k] = (cross @ clique.response.T + clique.remainder @ clique.remainder.T).reshape(k, 6, k, 6)
    return np.concatenate([clique.poses, clique.separator]), front.swapaxes(1, 2)
