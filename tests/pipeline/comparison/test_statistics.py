from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.pipeline.comparison.statistics import FEWEST_PAIRS, paired, spread_of

VALUES = st.dictionaries(st.integers(0, 20), st.one_of(st.floats(0.01, 100.0), st.just(math.inf)), max_size=12)


def test_spread_of_a_few_values():
    found = spread_of([3.0, 1.0, 2.0, 10.0])
    assert (found.runs, found.median, found.smallest, found.largest) == (4, 2.5, 1.0, 10.0)
    assert spread_of([]) is None


def test_a_failure_is_worse_than_any_number():
    assert spread_of([1.0, math.inf, 2.0]).median == 2.0
    assert math.isinf(spread_of([1.0, math.inf, math.inf]).median)
    assert math.isinf(spread_of([1.0, math.inf]).median)


def test_five_seeds_that_all_improve():
    base = {seed: 10.0 + seed for seed in range(5)}
    found = paired(dict.fromkeys(range(5), 1.0), base, "low")
    assert (found.pairs, found.better, found.worse) == (5, 5, 0)
    assert found.median_difference == -11.0
    assert found.p == pytest.approx(2 / 2**5)
    assert "Wilcoxon" in found.test
    assert paired(base, dict.fromkeys(range(5), 1.0), "low").worse == 5
    assert paired(base, dict.fromkeys(range(5), 1.0), "high").better == 5


def test_runs_that_failed_are_compared_by_signs():
    base = dict.fromkeys(range(6), math.inf)
    found = paired(dict.fromkeys(range(6), 0.5), base, "low")
    assert (found.better, found.worse, found.median_difference) == (6, 0, None)
    assert found.p == pytest.approx(2 / 2**6)
    assert found.test == "sign test"


def test_equal_arms_have_no_p():
    values = {seed: 1.0 + seed for seed in range(8)}
    found = paired({seed: value + 1e-13 for seed, value in values.items()}, values, "low")
    assert (found.better, found.worse, found.p) == (0, 0, None)
    assert "equal" in found.test


def test_few_seeds_are_said_to_be_too_few():
    found = paired({0: 1.0, 1: 1.0}, {0: 2.0, 1: 2.0, 2: 2.0}, "low")
    assert (found.pairs, found.better, found.p) == (2, 2, None)
    assert "2 of the 5 seeds" in found.test


@given(VALUES, VALUES)
def test_swapping_the_arms_swaps_the_verdict(arm, base):
    one, other = paired(arm, base, "low"), paired(base, arm, "low")
    assert (one.pairs, one.better, one.worse) == (other.pairs, other.worse, other.better)
    assert one.p == (None if other.p is None else pytest.approx(other.p))
    assert (one.p is None) == (one.pairs < FEWEST_PAIRS or one.better + one.worse == 0)
    assert one.p is None or 0 < one.p <= 1
