from __future__ import annotations

import logging

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.formats.epochs import epochs_at
from wiclosure.pipeline.sources.messages.point_times import PointClock, strays

STAMP_NS = 1_700_000_000_123_456_789
UNITS = {"s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}


@given(unit=st.sampled_from(sorted(UNITS)), sweep_s=st.floats(0.02, 1.0), first_s=st.floats(-0.5, 0.4))
def test_units_are_told_by_the_length_of_a_sweep(unit, sweep_s, first_s):
    seconds = np.linspace(first_s, first_s + sweep_s, 200)
    found = PointClock().seconds_after(STAMP_NS, seconds * 1e9 / UNITS[unit])
    np.testing.assert_allclose(found, seconds, atol=1e-9)


@pytest.mark.parametrize("unit", ["us", "ns"])
@pytest.mark.parametrize("clock_s", [0, 37])
def test_absolute_times_count_from_the_stamp_or_where_the_clock_is_another_from_the_first(unit, clock_s):
    ticks = (STAMP_NS + clock_s * 10**9 + np.arange(200) * 500_000) // UNITS[unit]
    found = PointClock().seconds_after(STAMP_NS, ticks.astype(np.uint64))
    expected = np.arange(200) * 0.0005
    np.testing.assert_allclose(found, expected, atol=2e-6 if unit == "us" else 1e-12)


def test_nanoseconds_since_1970_lose_no_digit():
    ticks = STAMP_NS + np.array([0, 1, 2, 99_999_999])
    np.testing.assert_allclose(PointClock().seconds_after(STAMP_NS, ticks), [0, 1e-9, 2e-9, 0.099999999], atol=1e-15)


def test_a_unit_is_kept_until_a_sweep_would_last_too_long(caplog):
    clock = PointClock("alpha.bag")
    with caplog.at_level(logging.INFO):
        clock.seconds_after(0, np.linspace(0, 100, 50))  # ms
        np.testing.assert_allclose(clock.seconds_after(0, np.linspace(0, 20, 5))[-1], 0.02)
        np.testing.assert_allclose(clock.seconds_after(0, np.linspace(0, 1e5, 5))[-1], 0.1)  # us after all
    assert caplog.text.count("alpha.bag: per-point times are in") == 2


def test_packets_of_a_millisecond_have_their_unit_by_the_time_between_scans():
    ticks = np.linspace(0, 1300, 30)  # us, of which 1.3 s would fit a sweep in ms
    assert PointClock().seconds_after(0, ticks)[-1] == pytest.approx(1.3)
    assert PointClock(period_s=0.00133).seconds_after(0, ticks)[-1] == pytest.approx(0.0013)


def test_times_that_say_nothing():
    assert PointClock().seconds_after(0, np.full(20, 5.0)) is None
    assert PointClock().seconds_after(0, np.zeros(0)) is None
    np.testing.assert_allclose(PointClock(ns_per_unit=10**9).seconds_after(0, np.full(20, 0.5)), 0.5)


def test_a_sweep_of_hours_is_used_without_times_and_said_once(caplog):
    clock = PointClock()
    for _ in range(2):
        assert clock.seconds_after(0, np.linspace(0, 1e13, 50)) is None
    assert caplog.text.count("such sweeps are used without them") == 1


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(300, 3000), far=st.floats(2.5, 1e6))
def test_wrong_times_are_strays_and_a_sweeps_own_are_none(seed, n, far):
    rng = np.random.default_rng(seed)
    times = rng.uniform(0.0, 0.1, n)
    assert strays(times) is None
    wrong = rng.choice(n, 2, replace=False)
    times[wrong] = [0.1 + 0.1 * far, -0.1 * far]
    assert np.flatnonzero(strays(times)).tolist() == sorted(wrong.tolist())


def test_among_few_points_and_where_many_are_late_there_are_no_strays():
    assert strays(np.array([0.0] * 18 + [99.0])) is None
    times = np.linspace(0.0, 0.1, 1000)
    times[-50:] = 5.0
    assert strays(times) is None


@pytest.mark.parametrize(("ns_per_unit", "name"), [(10**5, "100us"), (10**4, "10us"), (100, "100ns")])
def test_rare_units_are_told_by_sweeps_that_fill_the_time_between_scans(ns_per_unit, name, caplog):
    ticks = np.arange(0, 10**8, 10**5) // ns_per_unit
    found = PointClock("a.bag", period_s=0.1).seconds_after(STAMP_NS, ticks)
    np.testing.assert_allclose(found, ticks * ns_per_unit * 1e-9, atol=1e-9)
    assert f"units of {name}" in caplog.text


@pytest.mark.parametrize(("ns_per_unit", "share"), [(10**3, 0.3), (1, 0.11), (10**6, 0.05), (10**9, 1.0)])
def test_sweeps_of_a_sector_keep_the_usual_units(ns_per_unit, share):
    ticks = np.linspace(0, share * 1e8, 500) / ns_per_unit
    found = PointClock(period_s=0.1).seconds_after(STAMP_NS, ticks)
    assert found[-1] == pytest.approx(share * 0.1)


def test_a_rare_unit_is_given_up_when_a_later_sweep_is_longer():
    clock = PointClock(period_s=0.1)
    clock.seconds_after(STAMP_NS, np.linspace(0, 9.9e6, 500))  # a tenth of a sweep in ns, as if it were in units of 10
    assert clock.seconds_after(STAMP_NS, np.linspace(0, 9.9e7, 500))[-1] == pytest.approx(0.099)


@pytest.mark.parametrize("epoch", epochs_at(STAMP_NS)[1:])
@pytest.mark.parametrize("ns_per_unit", [100, 10**3, 10**6])
def test_dates_of_other_epochs_count_from_the_stamp(epoch, ns_per_unit, caplog):
    offsets_ns = np.arange(-50_000_000, 50_000_000, 100_000)
    ticks = [(STAMP_NS + epoch.before_1970_ns + offset) // ns_per_unit for offset in offsets_ns.tolist()]
    with caplog.at_level(logging.INFO):
        found = PointClock("a.bag", period_s=0.1).seconds_after(STAMP_NS, np.array(ticks, np.int64))
    np.testing.assert_allclose(found, offsets_ns * 1e-9, atol=ns_per_unit * 1.1e-9)
    assert epoch.name in caplog.text


@given(
    start_s=st.floats(0.5, 4.0), dtype=st.sampled_from(["u4", "f8"]),
    sweeps=st.integers(45, 60),
)  # fmt: skip
def test_32_bits_of_nanoseconds_go_on_when_they_begin_anew(start_s, dtype, sweeps):
    clock = PointClock(period_s=0.1)
    for sweep in range(sweeps):
        ns = (np.int64((start_s + 0.1 * sweep) * 1e9) + np.arange(0, 99_000_000, 90_000)) % 2**32
        found = clock.seconds_after(STAMP_NS + sweep * 10**8, ns.astype(dtype))
        np.testing.assert_allclose(found, np.arange(0, 99_000_000, 90_000) * 1e-9, atol=1e-12)


def test_offsets_before_the_stamp_in_unsigned_integers_are_negative():
    ns = np.arange(-50_000_000, 49_000_000, 90_000)
    clock = PointClock(period_s=0.1)
    for sweep in range(5):
        found = clock.seconds_after(STAMP_NS + sweep * 10**8, (ns % 2**32).astype(np.uint32))
        np.testing.assert_allclose(found, ns * 1e-9, atol=1e-12)
