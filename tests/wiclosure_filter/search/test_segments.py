"""The hierarchy of boxes: each holds its keyframes, and its parent holds it."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.wiclosure_filter.search.segments import LEAF, SegmentTree, TreeLevel, box_distance


@pytest.mark.parametrize("size", [1, LEAF, LEAF + 1, 100])
def test_every_box_holds_its_keyframes(size: int) -> None:
    rng = np.random.default_rng(size)
    positions, variance = np.cumsum(rng.normal(size=(size, 2)), axis=0), rng.uniform(0, 3, size)
    tree = SegmentTree.of(positions, variance)
    assert tree.count(len(tree.heights) - 1) == 1
    for height in range(len(tree.heights)):
        level = TreeLevel(tree, height)
        first, last = level.keyframes(np.arange(tree.count(height)))
        assert first[0] == 0
        assert last[-1] == size - 1
        np.testing.assert_array_equal(first[1:], last[:-1] + 1)
        for segment, (start, end) in enumerate(zip(first, last, strict=True)):
            inside = slice(start, end + 1)
            np.testing.assert_array_equal(level.segments.low[segment], positions[inside].min(axis=0))
            np.testing.assert_array_equal(level.segments.high[segment], positions[inside].max(axis=0))
            assert level.segments.own_variance[segment] == variance[inside].max()


def test_children_share_their_parents_keyframes() -> None:
    tree = SegmentTree.of(np.zeros((40, 2)), np.zeros(40))
    parents = np.arange(tree.count(1))
    assert TreeLevel(tree, 1).keyframes(parents)[0].tolist() == TreeLevel(tree, 0).keyframes(2 * parents)[0].tolist()


def test_distance_between_boxes_is_that_of_the_nearest_points() -> None:
    unit = np.array([[0.0, 0.0], [1.0, 1.0]])
    boxes = [SegmentTree.of(unit + offset, np.zeros(2)).heights[0] for offset in ([0, 0], [4, 0], [4, 5], [0.5, 0.5])]
    zero = np.zeros(1, np.int64)
    distances = [float(box_distance(boxes[0], zero, other, zero)[0]) for other in boxes]
    assert distances == [0.0, 3.0, 5.0, 0.0]  # itself, beside, 3 across and 4 up, overlapping
