"""Where do two trajectories come near each other?  Branch and bound over two hierarchies of boxes (paper, IV-B).

Both trajectories start as one segment each.  A pair of segments whose boxes are too far apart for the gate, given the
uncertainty bound *of this pair of segments* (the paper has one bound for everything), is dropped with all its pairs of
keyframes; the others are split.  Levels are processed as arrays, so that the cost follows the output.  No pair that
the gate keeps is lost.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from wiclosure.errors import InputError
from wiclosure.types import FloatArray, IntArray
from wiclosure.wiclosure_filter.search.gates import Gate
from wiclosure.wiclosure_filter.search.pair_model import PairModel
from wiclosure.wiclosure_filter.search.pairs import MOST_PAIRS
from wiclosure.wiclosure_filter.search.segments import LEAF, SegmentTree, TreeLevel, box_distance

# Pairs of segments split at a time; bounds the memory where nearly everything overlaps.
SEGMENTS_AT_ONCE = 1 << 13


@dataclass(frozen=True, slots=True, eq=False)
class KeptPairs:
    """Pairs that the gate keeps, sorted by a, then b.

    Args:
        index_a, index_b: `(M,)` keyframes.
        overlap_probability, mahalanobis: `(M,)` by the gate.
    """

    index_a: IntArray
    index_b: IntArray
    overlap_probability: FloatArray
    mahalanobis: FloatArray

    def rows(self, chosen: IntArray) -> KeptPairs:
        """Some of the pairs."""
        return KeptPairs(
            self.index_a[chosen], self.index_b[chosen], self.overlap_probability[chosen], self.mahalanobis[chosen]
        )

    @classmethod
    def joined(cls, parts: list[KeptPairs]) -> KeptPairs:
        """All pairs of several disjoint parts, in order."""
        if not parts:
            return cls(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
        whole = cls(
            np.concatenate([p.index_a for p in parts]),
            np.concatenate([p.index_b for p in parts]),
            np.concatenate([p.overlap_probability for p in parts]),
            np.concatenate([p.mahalanobis for p in parts]),
        )
        return whole.rows(np.lexsort((whole.index_b, whole.index_a)))

    @classmethod
    def united(cls, parts: list[KeptPairs]) -> KeptPairs:
        """All pairs of several parts, in order; of one that occurs in several, the most probable."""
        if len(parts) == 1:
            return parts[0]
        whole = cls.joined(parts)
        whole = whole.rows(np.lexsort((-whole.overlap_probability, whole.index_b, whole.index_a)))
        again = (np.diff(whole.index_a, prepend=-1) == 0) & (np.diff(whole.index_b, prepend=-1) == 0)
        return whole.rows(np.flatnonzero(~again))

    def best(self, budget: int | None) -> KeptPairs:
        """The most probable pairs, at most `budget`; still in order."""
        if budget is None or len(self.index_a) <= budget:
            return self
        return self.rows(np.sort(np.argsort(-self.overlap_probability, kind="stable")[:budget]))


@dataclass(slots=True, eq=False)
class SearchTrace:
    """Pairs of segments that survived, by step, for pictures (paper, figure 5).

    Args:
        steps: for each step from the roots down: heights of a and b, and the surviving segments `(K,)` of each.
    """

    steps: dict[int, list[tuple[int, int, IntArray, IntArray]]] = field(default_factory=dict)


def find_overlap(model: PairModel, gate: Gate, trace: SearchTrace | None = None) -> KeptPairs:
    """All pairs of keyframes that the gate keeps.

    Args:
        model: predicted displacements of all pairs.
        gate: decides on pairs, and bounds its decision for groups of them.
        trace: collects the surviving segments of every step, where given.

    Raises:
        InputError: more pairs are kept than can be listed.
    """
    trees = tuple(SegmentTree.of(places.positions, places.own_variance) for places in (model.a, model.b))
    root = np.zeros(1, np.int64)
    waiting = [(max(len(tree.heights) for tree in trees) - 1, root, root)]
    kept: list[KeptPairs] = []
    found = 0
    while waiting:
        step, segment_a, segment_b = waiting.pop()
        a, b = (TreeLevel(tree, min(step, len(tree.heights) - 1)) for tree in trees)
        bounds = _bounds(model, a, segment_a, b, segment_b)
        near = gate.may_keep(*bounds)
        segment_a, segment_b = segment_a[near], segment_b[near]
        if trace is not None:
            trace.steps.setdefault(step, []).append((a.height, b.height, segment_a, segment_b))
        if step == 0:
            kept.append(_gated(model, gate, segment_a, segment_b, bounds[1][near], bounds[2][near]))
            found += len(kept[-1].index_a)
            _refuse_too_many(found)
            continue
        # A trajectory that is not as high waits for the other.
        if step <= a.height:
            segment_a, segment_b = _children(a, segment_a, segment_b)
        if step <= b.height:
            segment_b, segment_a = _children(b, segment_b, segment_a)
        waiting += [
            (step - 1, segment_a[i : i + SEGMENTS_AT_ONCE], segment_b[i : i + SEGMENTS_AT_ONCE])
            for i in range(0, len(segment_a), SEGMENTS_AT_ONCE)
        ]
    return KeptPairs.joined(kept)


def _refuse_too_many(found: int) -> None:
    if found > MOST_PAIRS:
        raise InputError(
            f"more than {MOST_PAIRS} pairs of keyframes may overlap, too many to list; raise gate.min_probability,"
            " lower gate.sensor_range_m or use fewer keyframes"
        )


def _bounds(
    model: PairModel, a: TreeLevel, segment_a: IntArray, b: TreeLevel, segment_b: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Shortest distance, largest variance and smallest spread `(K,)` of all pairs of keyframes of two segments."""
    largest, smallest = model.bounds(*a.keyframes(segment_a), *b.keyframes(segment_b))
    largest = largest + a.segments.own_variance[segment_a] + b.segments.own_variance[segment_b]
    return box_distance(a.segments, segment_a, b.segments, segment_b), largest, smallest


def _children(level: TreeLevel, parents: IntArray, others: IntArray) -> tuple[IntArray, IntArray]:
    """Both halves of each segment, and the other robot's segment once for each."""
    children = np.concatenate([2 * parents, 2 * parents + 1])
    exists = children < level.tree.count(level.height - 1)
    return children[exists], np.tile(others, 2)[exists]


def _gated(
    model: PairModel, gate: Gate, leaf_a: IntArray, leaf_b: IntArray, largest: FloatArray, smallest: FloatArray
) -> KeptPairs:
    """The pairs of keyframes of pairs of leaves that are kept; far ones are dropped by the bounds of their leaves."""
    within = np.arange(LEAF)
    p = (leaf_a[:, None, None] * LEAF + within[:, None] + 0 * within).ravel()
    k = (leaf_b[:, None, None] * LEAF + within + 0 * within[:, None]).ravel()
    exists = (p < len(model.a)) & (k < len(model.b))
    leaf, p, k = np.flatnonzero(exists) // LEAF**2, p[exists], k[exists]
    displacement = model.displacement(p, k)
    near = gate.may_keep(np.linalg.norm(displacement, axis=1), largest[leaf], smallest[leaf])
    near[near] = model.applies(p[near], k[near])
    p, k = p[near], k[near]
    scores = gate.score(displacement[near], model.covariance(p, k))
    p, k = p + model.first[0], k + model.first[1]
    return KeptPairs(p[scores.keep], k[scores.keep], scores.overlap_probability, scores.mahalanobis)
