from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from wiclosure.pipeline.sources.messages.wrapped_times import counter_range, unwrapped


def found(raw: np.ndarray) -> int | None:
    return counter_range(raw, raw.min().item(), raw.max().item())


RANGES = [2**32, 1, 1000, 10**6, 10**9, 3600 * 10**6, 604_800 * 10**9]


@given(size=st.sampled_from(RANGES), share=st.floats(0.05, 0.95), sweep=st.floats(0.001, 0.3))
def test_counters_that_begin_anew_are_told_and_go_on(size: int, share: float, sweep: float) -> None:
    steady = np.linspace(size * (1 - share * sweep), size * (1 + (1 - share) * sweep), 2000)
    raw = steady % size
    assert found(raw) == size
    np.testing.assert_allclose(unwrapped(raw, size, goes_on=True), steady, rtol=1e-12)
    np.testing.assert_allclose(unwrapped(raw, size, goes_on=False), steady - size, atol=1e-11 * size)


@example(first=2.0**52 + 1, length=1.0, seed=0)  # two values are all that float64 has there
@example(first=2.0**51, length=1.0, seed=0)  # three
@given(first=st.floats(-1e9, 1e18), length=st.floats(1e-3, 1e9), seed=st.integers(0, 2**32 - 1))
def test_sweeps_without_a_gap_are_left_alone(first: float, length: float, seed: int) -> None:
    assert found(first + length * np.random.default_rng(seed).uniform(size=300)) is None


@pytest.mark.parametrize("raw", [np.zeros(100), np.arange(5), np.repeat([0.0, 7.0], 50), np.repeat([0, 2**31], 50)])
def test_what_no_counter_does_is_left_alone(raw: np.ndarray) -> None:
    assert found(raw) is None


def test_signed_integers_begin_anew_below_zero() -> None:
    steady = 2**31 + np.arange(-40_000_000, 60_000_000, 50_000)
    raw = steady.astype(np.uint32).astype(np.int32).astype(np.int64)
    assert found(raw) == 2**32
    assert np.ptp(unwrapped(raw, 2**32, goes_on=True)) == np.ptp(steady)
