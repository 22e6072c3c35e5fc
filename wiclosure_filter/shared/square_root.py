"""Sparse square root of a pose graph's information matrix, and rows of its inverse where they are asked for.

GTSAM eliminates the poses in a nested dissection order: `Lambda = R^T R` with R upper triangular and sparse.  The
covariance is `Lambda^-1 = R^-1 R^-T`: with the rows V of R^-1, poses n and m have the covariance `V_n V_m^T`.  A pose's
row has numbers only where its ancestors in the elimination tree stand (Davis, Direct Methods for Sparse Linear Systems,
2006, section 3), of which a graph that lies in a plan has few.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Generic, TypeVar

import gtsam
import numpy as np

from wiclosure.types import FloatArray, IntArray

MOST_BYTES = 1 << 28  # of rows that are kept: what robots share that lie near each other

_Value = TypeVar("_Value")


class Recent(Generic[_Value]):
    """What was used last, up to so many bytes."""

    def __init__(self, most_bytes: int) -> None:
        self._values: OrderedDict[int, tuple[_Value, int]] = OrderedDict()
        self._most_bytes, self._bytes = most_bytes, 0

    def __contains__(self, key: int) -> bool:
        return key in self._values

    def __getitem__(self, key: int) -> _Value:
        return self._values[key][0]

    def add(self, key: int, value: _Value, size: int) -> None:
        """A new one, of so many bytes."""
        self._values[key] = value, size
        self._bytes += size

    def forget(self, used: Iterable[int]) -> None:
        """Keeps what is used now, the later ones longer, and of the rest what fits."""
        now = list(used)
        for key in now:
            self._values.move_to_end(key)
        while self._bytes > self._most_bytes and len(self._values) > len(now):
            self._bytes -= self._values.popitem(last=False)[1][1]


class _Front:
    """Joint covariance of some poses, to which one more is added in place: those of one subtree share it."""

    def __init__(self, members: IntArray | None = None, room: FloatArray | None = None) -> None:
        self.members = np.zeros(0, np.int64) if members is None else members
        self._room = np.zeros((6, 6)) if room is None else room

    @property
    def covariance(self) -> FloatArray:
        """`(6 M, 6 M)`."""
        return self._room[: 6 * len(self.members), : 6 * len(self.members)]

    def only(self, places: IntArray) -> _Front:
        """Of some of the poses, which increase as they do."""
        if len(places) == len(self.members):
            return self
        wanted = (6 * np.searchsorted(self.members, places)[:, None] + np.arange(6)).ravel()
        size = len(wanted)
        room = np.empty((2 * size + 6, 2 * size + 6))
        room[:size, :size] = self._room[wanted[:, None], wanted]
        return _Front(places, room)

    def extended(self, place: int, cross: FloatArray, variance: FloatArray) -> _Front:
        """With one pose more, of which the covariance with the others is `cross (6, 6 M)`."""
        size = 6 * len(self.members)
        room = self._room
        if size + 6 > len(room):
            room = np.empty((2 * size + 6, 2 * size + 6))
            room[:size, :size] = self.covariance
        room[size : size + 6, :size], room[:size, size : size + 6] = cross, cross.T
        room[size : size + 6, size : size + 6] = variance
        return _Front(np.append(self.members, place), room)


@dataclass(frozen=True, eq=False)
class SquareRoot:
    """Of the information of K poses.

    Poses stand in their *places*, the reverse order of elimination: ancestors come first.

    Args:
        place: `(K,)` of each pose.
        parent: `(K,)` place of the nearest ancestor of each place; -1 at a root.
        start: `(K + 1,)` where the separator of each place begins.
        separator: `(S,)` places that the pose of a place depends on, ancestors all, increasing.
        response: `(6, 6 S)` how it follows them, `-R_nn^-1 R_ns`.
        remainder: `(K, 6, 6)` the independent rest, `R_nn^-1`.
        solution: `(K, 6)` the poses' movements that solve the linearised graph.
    """

    place: IntArray
    parent: IntArray
    start: IntArray
    separator: IntArray
    response: FloatArray
    remainder: FloatArray
    solution: FloatArray
    _known: Recent[tuple[IntArray, FloatArray]] = field(default_factory=lambda: Recent(MOST_BYTES), repr=False)

    @classmethod
    def of(cls, linear: gtsam.GaussianFactorGraph) -> SquareRoot:
        """Of a linearised graph over poses 0 ... K-1.

        Raises:
            numpy.linalg.LinAlgError: some pose is not determined.
        """
        try:
            net = linear.eliminateSequential(gtsam.Ordering.MetisGaussianFactorGraph(linear))
        except RuntimeError as error:
            raise np.linalg.LinAlgError(str(error).strip().splitlines()[0]) from None
        size = net.size()
        conditionals = [net.at(size - 1 - place) for place in range(size)]
        keys = [np.array(conditional.keys(), np.int64) for conditional in conditionals]
        place = np.empty(size, np.int64)
        place[[own[0] for own in keys]] = np.arange(size)
        after = [np.argsort(place[own[1:]]) for own in keys]
        separators = [place[own[1:]][order] for own, order in zip(keys, after, strict=True)]
        remainder = np.linalg.inv(np.array([conditional.R() for conditional in conditionals]))
        responses = [
            -rest @ conditional.S().reshape(6, -1, 6)[:, order].reshape(6, -1)
            for rest, conditional, order in zip(remainder, conditionals, after, strict=True)
            if len(order)
        ]
        solution = net.optimize()
        return cls(
            place,
            np.array([own.max(initial=-1) for own in separators], np.int64),
            np.cumsum([0, *(len(own) for own in separators)]),
            np.concatenate(separators),
            np.hstack([np.zeros((6, 0)), *responses]),
            remainder,
            np.array([solution.at(key) for key in range(size)]),
        )

    def rows(self, poses: IntArray) -> tuple[FloatArray, IntArray]:
        """Rows `(P, 6, 6 C)` of R^-1, and the places `(C,)` of their columns, increasing."""
        wanted = self.place[poses]
        columns = self.with_ancestors(poses)
        for place in columns.tolist():  # ancestors first
            if place not in self._known:
                path, values = self._row(place)
                self._known.add(place, (path, values), path.nbytes + values.nbytes)
        rows = np.zeros((len(wanted), 6, len(columns), 6))
        for row, place in zip(rows, wanted.tolist(), strict=True):
            path, values = self._known[place]
            row[:, np.searchsorted(columns, path)] = values.reshape(6, len(path), 6)
        self._known.forget(columns[::-1].tolist())  # ancestors, which more poses share, are kept longer
        return rows.reshape(len(wanted), 6, -1), columns

    def _row(self, place: int) -> tuple[IntArray, FloatArray]:
        """The way from the root to a place, and its row `(6, 6 A)` of R^-1 on it; those of its ancestors are known."""
        separator, response = self._followed(place)
        above = self._known[int(self.parent[place])][0] if len(separator) else np.zeros(0, np.int64)
        known = np.zeros((6 * len(separator), 6 * len(above)))
        for number, other in enumerate(separator.tolist()):
            values = self._known[other][1]
            known[6 * number : 6 * number + 6, : values.shape[1]] = values
        return np.append(above, place), np.hstack([response @ known, self.remainder[place]])

    def with_one(self, poses: IntArray, one: int) -> FloatArray:
        """Covariances `(n, 6, 6)` of poses with one pose: a column of the inverse, by two sparse substitutions."""
        found = np.zeros((len(self.place), 6, 6))
        place = int(self.place[one])
        found[place] = np.eye(6)
        while place >= 0:  # what a pose follows is pulled with it
            separator, response = self._followed(place)
            found[separator] += (response.T @ found[place]).reshape(-1, 6, 6)
            found[place] = self.remainder[place] @ (self.remainder[place].T @ found[place])
            place = int(self.parent[place])
        for place in self.with_ancestors(poses).tolist():  # ancestors first
            separator, response = self._followed(place)
            found[place] += response @ found[separator].reshape(-1, 6)
        return found[self.place[poses]]

    def _followed(self, place: int) -> tuple[IntArray, FloatArray]:
        """The separator of a place, and how its pose follows that."""
        first, end = self.start[place], self.start[place + 1]
        return self.separator[first:end], self.response[:, 6 * first : 6 * end]

    def chains(self) -> tuple[FloatArray, FloatArray]:
        """Covariance `(K, 6, 6)` of each pose, and `(K - 1, 6, 6)` of each pose with the next one; 0 where apart.

        With the covariance of all that a pose follows known, its own comes of it (Takahashi et al., Formation of a
        sparse bus impedance matrix, 1973): what it follows is its nearest ancestor, or followed by that.
        """
        own, following = np.zeros((len(self.place), 6, 6)), np.zeros((max(len(self.place) - 1, 0), 6, 6))
        pose = np.argsort(self.place)
        depth, order = self._depth_first()
        fronts = [_Front()] * (int(depth.max()) + 2)  # on the way to a place, each with what the place follows
        for place in order:
            separator, response = self._followed(place)
            front = fronts[int(depth[place])].only(separator)
            cross = response @ front.covariance
            own[pose[place]] = cross @ response.T + self.remainder[place] @ self.remainder[place].T
            fronts[int(depth[place]) + 1] = front.extended(place, cross, own[pose[place]])
            for other in np.flatnonzero(np.abs(pose[separator] - pose[place]) == 1):
                beside, block = int(pose[separator[other]]), cross[:, 6 * other : 6 * other + 6]
                following[min(beside, pose[place])] = block if beside > pose[place] else block.T
        return own, following

    def _depth_first(self) -> tuple[IntArray, list[int]]:
        """How many ancestors each place has, and all places, each after its ancestors and before those beside them."""
        depth = np.zeros(len(self.parent), np.int64)
        children: list[list[int]] = [[] for _ in self.parent]
        waiting = []
        for place, parent in enumerate(self.parent.tolist()):
            if parent < 0:
                waiting.append(place)
            else:
                depth[place] = depth[parent] + 1
                children[parent].append(place)
        order = []
        while waiting:
            order.append(waiting.pop())
            waiting += children[order[-1]]
        return depth, order

    def with_ancestors(self, poses: IntArray) -> IntArray:
        """Places of poses and of all that they depend on, increasing."""
        found: set[int] = set()
        for own in self.place[poses].tolist():
            place = own
            while place >= 0 and place not in found:
                found.add(place)
                place = self._parents[place]
        return np.array(sorted(found), np.int64)

    @cached_property
    def _parents(self) -> list[int]:
        return [int(place) for place in self.parent]
