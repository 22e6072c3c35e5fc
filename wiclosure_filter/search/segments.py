"""A trajectory as a binary hierarchy of contiguous segments, each in a bounding box (paper, section IV-B).

The hierarchy is implicit: segment s at height h holds keyframes `s * size` to `(s + 1) * size - 1` with
`size = LEAF * 2^h`, so its children at height h - 1 are 2 s and 2 s + 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray, IntArray

# Keyframes of a leaf.  Below it one array operation on all pairs of two leaves is cheaper than another level.
LEAF = 8


@dataclass(frozen=True, slots=True, eq=False)
class Segments:
    """The segments of one height.

    Args:
        low, high: `(S, d)` corners of the boxes, metres.
        own_variance: `(S,)` m^2, largest `own_variance` of the keyframes in each.
    """

    low: FloatArray
    high: FloatArray
    own_variance: FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SegmentTree:
    """All heights of one trajectory's hierarchy.

    Args:
        size: number of keyframes.
        heights: segments by height, leaves first; the last holds one segment.
    """

    size: int
    heights: tuple[Segments, ...]

    @classmethod
    def of(cls, positions: FloatArray, own_variance: FloatArray) -> SegmentTree:
        """Builds the hierarchy of N >= 1 keyframes.

        Args:
            positions: `(N, d)`, in the frame that both robots share.
            own_variance: `(N,)` m^2 of each keyframe's own (see `pair_model`).
        """
        starts = np.arange(0, len(positions), LEAF)
        heights = [
            Segments(
                np.minimum.reduceat(positions, starts),
                np.maximum.reduceat(positions, starts),
                np.maximum.reduceat(own_variance, starts),
            )
        ]
        while len(heights[-1].own_variance) > 1:
            below = heights[-1]
            starts = np.arange(0, len(below.own_variance), 2)
            heights.append(
                Segments(
                    np.minimum.reduceat(below.low, starts),
                    np.maximum.reduceat(below.high, starts),
                    np.maximum.reduceat(below.own_variance, starts),
                )
            )
        return cls(len(positions), tuple(heights))

    def count(self, height: int) -> int:
        """How many segments there are at a height."""
        return len(self.heights[height].own_variance)


@dataclass(frozen=True, slots=True, eq=False)
class TreeLevel:
    """One height of a trajectory's hierarchy."""

    tree: SegmentTree
    height: int

    @property
    def segments(self) -> Segments:
        """The segments of this height."""
        return self.tree.heights[self.height]

    def keyframes(self, segment: IntArray) -> tuple[IntArray, IntArray]:
        """First and last keyframe `(K,)` of segments."""
        size = LEAF << self.height
        return segment * size, np.minimum((segment + 1) * size, self.tree.size) - 1


def box_distance(a: Segments, segment_a: IntArray, b: Segments, segment_b: IntArray) -> FloatArray:
    """Shortest distance `(K,)` between the boxes of pairs of segments; 0 where they touch."""
    gap = np.maximum(a.low[segment_a] - b.high[segment_b], b.low[segment_b] - a.high[segment_a])
    return np.asarray(np.linalg.norm(np.maximum(gap, 0.0), axis=1))
