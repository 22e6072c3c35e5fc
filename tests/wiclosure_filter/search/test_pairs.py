"""Index arrays of keyframe pairs."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.errors import InputError
from wiclosure.types import Trajectory
from wiclosure.wiclosure_filter.search.pairs import all_pairs, count_pairs, from_codes


def test_all_pairs_in_order() -> None:
    pairs = all_pairs("a", 2, "b", 3)
    assert pairs.index_a.tolist() == [0, 0, 0, 1, 1, 1]
    assert pairs.index_b.tolist() == [0, 1, 2, 0, 1, 2]
    assert pairs.predictor is None
    assert np.isnan(pairs.overlap_probability).all()


def test_codes_are_taken_apart_again() -> None:
    pairs = from_codes("a", "b", np.array([1, 5, 7]), 3)
    assert list(zip(pairs.index_a.tolist(), pairs.index_b.tolist(), strict=True)) == [(0, 1), (1, 2), (2, 1)]


def test_pairs_between_different_robots_are_counted() -> None:
    sizes = {"a": 2, "b": 3, "c": 5}
    team = {n: Trajectory(n, np.arange(size) * 10**9, np.tile(np.eye(4), (size, 1, 1))) for n, size in sizes.items()}
    assert count_pairs(team) == 2 * 3 + 2 * 5 + 3 * 5
    assert count_pairs({}) == 0


def test_too_many_pairs_are_one_sentence() -> None:
    with pytest.raises(InputError, match="a and b have 100000 and 100000 keyframes"):
        all_pairs("a", 100_000, "b", 100_000)
