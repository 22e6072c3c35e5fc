"""Comparisons of closures between two robots, which hold as long as neither of the two changes."""

from __future__ import annotations

from collections.abc import Callable, Hashable

import numpy as np

from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.sets.alignment import ANCHORS, ClosureComparison
from wiclosure.types import FloatArray, IntArray


class KnownComparisons:
    """What closures between two robots say, each of these by itself, in a team of which some robots may be cut.

    A cut changes two parts of one robot: what the others say of each other is looked up.

    Args:
        before: those of the team before the last cut; None of a whole team.
    """

    def __init__(self, before: KnownComparisons | None = None) -> None:
        self._before = before
        self._found: dict[Hashable, ClosureComparison] = {}

    def of(self, key: Hashable, beyond: float, compare: Callable[[], ClosureComparison]) -> ClosureComparison:
        """The comparison with this key, exact up to a squared distance of `beyond`; `compare` makes what is missing."""
        found = self._lookup(key, beyond)
        if found is None:
            found = self._found[key] = compare()
        return found

    def _lookup(self, key: Hashable, beyond: float) -> ClosureComparison | None:
        found = self._found.get(key)
        if found is not None and _serves(found, beyond):
            return found
        return self._before._lookup(key, beyond) if self._before else None


def _serves(found: ClosureComparison, beyond: float) -> bool:
    """Where closures are many, the anchors depend on how far apart they may be."""
    return found.beyond == beyond or (found.beyond > beyond and len(found.claims) <= ANCHORS)


def key_of_pair(robots: Robots, rows: IntArray, odometry_factors: FloatArray) -> Hashable:
    """What tells a comparison of closures `rows` between two robots from others: parts of a cut robot have other nodes.

    Args:
        robots: the team.
        rows: all closures between two of them.
        odometry_factors: `(R,)` on the standard deviations of each robot's odometry.
    """
    ends = robots.robot[robots.loop_ends[:, rows[0]]]
    nodes = np.append(robots.first_nodes, len(robots.robot))
    return rows.tobytes(), *nodes[ends].tolist(), *nodes[ends + 1].tolist(), *odometry_factors[ends].tolist()
