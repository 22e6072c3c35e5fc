from __future__ import annotations

import numpy as np

from wiclosure.backends.sets.dense_sets import dense_sets


def block(sizes, missing=0.0, seed=0):
    """Sets in which most pairs agree, and none between them."""
    rng, label = np.random.default_rng(seed), np.repeat(np.arange(len(sizes)), sizes)
    agree = (label[:, None] == label) & (rng.uniform(size=(len(label),) * 2) >= missing)
    agree &= agree.T
    return agree


def test_sets_come_whole_and_largest_first():
    found = dense_sets(block([3, 7, 5]), most=3)
    assert [set(members) for members in found] == [set(range(3, 10)), set(range(10, 15)), set(range(3))]


def test_pairs_that_noise_sets_apart_break_no_set():
    """One pair in twenty disagrees: the maximum clique loses members, the dense set none."""
    (members,) = dense_sets(block([200], missing=0.05), most=1)
    assert len(members) == 200


def test_a_closure_that_agrees_with_few_is_no_member():
    agree = block([10, 1])
    agree[10, :3] = agree[:3, 10] = True
    assert [len(members) for members in dense_sets(agree, most=2)] == [10]


def test_where_none_agree_there_is_no_set():
    assert dense_sets(np.eye(5, dtype=bool), most=2) == []
    assert dense_sets(np.zeros((0, 0), bool), most=2) == []
