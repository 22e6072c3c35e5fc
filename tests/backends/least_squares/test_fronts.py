from __future__ import annotations

import gtsam
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.backends.least_squares import fronts as fronts_module
from wiclosure.backends.least_squares.fronts import elimination_positions, fronts_of


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), size=st.integers(2, 120), edges=st.integers(0, 200))
def test_fronts_hold_all_that_elimination_fills(seed, size, edges):
    rng = np.random.default_rng(seed)
    first = rng.integers(0, size - 1, edges)
    second = rng.integers(first + 1, size)
    position, fronts = fronts_of(first, second, size)
    assert sorted(position.tolist()) == list(range(size))
    assert [front.start for front in fronts] == [0, *(front.stop for front in fronts[:-1])]
    assert fronts[-1].stop == size
    held = np.zeros((size, size), bool)
    for n, front in enumerate(fronts):
        held[front.start : front.stop, front.start : front.stop] = True
        held[front.start : front.stop, front.rest] = True
        if len(front.rest):
            above = fronts[front.parent]
            assert front.parent > n
            assert np.isin(front.rest, [*range(above.start, above.stop), *above.rest]).all()
    filled = _filled(position[first], position[second], size)
    assert not (filled & ~held)[np.triu_indices(size)].any()


def _filled(first, second, size):
    """Which entries elimination one by one makes other than zero."""
    filled = np.eye(size, dtype=bool)
    filled[first, second] = filled[second, first] = True
    for node in range(size):
        later = node + 1 + np.flatnonzero(filled[node, node + 1 :])
        filled[np.ix_(later, later)] = True
    return filled


def test_fronts_of_a_grid_stay_small():
    """A band matrix would hold side^3 blocks; nested dissection holds side^2 log side."""
    side = 40
    nodes = np.arange(side * side).reshape(side, side)
    first = np.concatenate([nodes[:, :-1].ravel(), nodes[:-1].ravel()])
    second = np.concatenate([nodes[:, 1:].ravel(), nodes[1:].ravel()])
    _, fronts = fronts_of(first, second, side * side)
    sizes = np.array([(front.stop - front.start, len(front.rest)) for front in fronts])
    blocks = int((sizes[:, 0] * (sizes[:, 0] + 1) // 2 + sizes[:, 0] * sizes[:, 1]).sum())
    assert blocks < 0.75 * side**3
    assert len(fronts) < side * side / 10


def test_a_path_in_order_is_no_one_front(monkeypatch):
    monkeypatch.setattr(fronts_module, "elimination_positions", lambda first, second, size: np.arange(size))
    _, fronts = fronts_of(np.arange(999), np.arange(1, 1000), 1000)
    assert max(front.stop - front.start for front in fronts) < 60


@pytest.mark.parametrize(("first", "second", "size"), [([], [], 3), ([0], [1], 5), ([4, 1], [1, 2], 6)])
def test_every_node_has_a_place_joined_or_not(first, second, size):
    positions = elimination_positions(np.array(first, int), np.array(second, int), size)
    assert sorted(positions.tolist()) == list(range(size))


def test_every_node_has_a_place_where_metis_fails(monkeypatch):
    monkeypatch.setattr(gtsam.Ordering, "MetisSymbolicFactorGraph", lambda graph: gtsam.Ordering())
    position = elimination_positions(np.arange(9), np.arange(1, 10), 10)
    assert sorted(position.tolist()) == list(range(10))
