"""Sets of closures that contradict the accepted ones and may as well be the true ones."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import pairwise

import networkx as nx
import numpy as np

from wiclosure.backends.sets.candidate_sets import CandidateSet
from wiclosure.types import BoolArray

ONE_PLACE = 2  # closures that agree by being of the same place


def rivals(candidates: Sequence[CandidateSet], inlier: BoolArray) -> Mapping[tuple[int, int], int]:
    """By two robots, the closures left out of the largest set that is half as strong as what it contradicts, at least.

    Not half as large: along a stretch that looks like another, any number agrees.  One that only another set of its
    pair objects to contradicts that.  One that may be of one look-alike place is no proof, but speaks against the
    weakest of the accepted sets that join its robots otherwise: where these are hardly stronger, they may be so too.

    Args:
        candidates: sets between robots.
        inlier: `(M,)` closures that are accepted.
    """
    accepted = {n for n, c in enumerate(candidates) if 2 * np.count_nonzero(inlier[c.rows]) > len(c)}
    strongest: dict[tuple[int, int], float] = defaultdict(float)
    joining: nx.Graph[int] = nx.Graph()
    for c in sorted((candidates[n] for n in accepted), key=lambda c: c.strength):
        strongest[c.a, c.b] = c.strength
        if c.holds:
            joining.add_edge(c.a, c.b, strength=c.strength)
    tree, found = nx.maximum_spanning_tree(joining, weight="strength"), dict[tuple[int, int], int]()
    for n, c in enumerate(candidates):
        contradicted = strongest[c.a, c.b] if c.rivalled else 0.0
        if c.one_place and n not in accepted:
            contradicted = _weakest(tree, c.a, c.b)
        left_out = int(np.count_nonzero(~inlier[c.rows]))
        if not c.refutation and 2.0 * c.strength >= contradicted > 0.0 and left_out > ONE_PLACE:
            found[c.a, c.b] = max(found.get((c.a, c.b), 0), left_out)
    return found


def _weakest(tree: nx.Graph[int], a: int, b: int) -> float:
    """Strength of the weakest set on the way between two robots; 0 where there is none."""
    if not (a in tree and b in tree and nx.has_path(tree, a, b)):
        return 0.0
    return min(float(tree.edges[step]["strength"]) for step in pairwise(nx.shortest_path(tree, a, b)))
