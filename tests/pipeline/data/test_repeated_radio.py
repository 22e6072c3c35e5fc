from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.pipeline.data.repeated_radio import each_once
from wiclosure.types import AoaPath, Heading, WirelessLog, WirelessMeasurement

START_NS = 1_700_000_000 * 10**9


def heard(seed: int = 0, count: int = 50) -> WirelessLog:
    """Some ten measurements a second, with all digits."""
    rng = np.random.default_rng(seed)
    stamps_ns = START_NS + np.cumsum(rng.integers(80 * 10**6, 120 * 10**6, count))
    return WirelessLog(
        tuple(
            WirelessMeasurement(int(ns), "alpha", "beta", float(m), 0.1)
            for ns, m in zip(stamps_ns, 20 + np.cumsum(rng.normal(0, 0.1, count)), strict=True)
        )
    )


def written(log: WirelessLog, stamp_ns: int, range_m: float) -> WirelessLog:
    """As a table has it, rounded to these units."""
    return WirelessLog(
        tuple(
            replace(m, stamp_ns=round(m.stamp_ns / stamp_ns) * stamp_ns, range_m=round(m.range_m / range_m) * range_m)
            for m in log.measurements
            if m.range_m is not None
        )
    )


@given(st.integers(0, 2**20), st.sampled_from([10**6, 10**7, 1000]), st.sampled_from([0.001, 0.01]), st.booleans())
def test_a_table_of_what_the_bags_hold_counts_once(seed: int, stamp_ns: int, range_m: float, first: bool) -> None:
    log = heard(seed)
    table = written(log, stamp_ns, range_m)
    logs = [("bag", log), ("table", table)] if first else [("table", table), ("bag", log)]
    assert each_once(logs).measurements == (log if first else table).measurements


def test_it_is_said_which_log_to_leave_out(caplog: pytest.LogCaptureFixture) -> None:
    log = heard()
    table = written(WirelessLog(log.measurements[10:]), 10**6, 0.001)
    each_once([("alpha.bag", log), ("uwb.csv", table)])
    assert (
        "uwb.csv: 40 of 40 measurements are in alpha.bag too, and count once; leave one of the two out" in caplog.text
    )


def test_what_a_table_has_besides_stays() -> None:
    log = heard()
    table = written(log, 10**6, 0.001)
    assert len(each_once([("bag", WirelessLog(log.measurements[:30])), ("table", table)]).measurements) == 50


def test_the_log_with_bearings_is_kept_and_the_other_way_round_is_the_same() -> None:
    log = heard()
    bearings = WirelessLog(tuple(replace(m, paths=(AoaPath(0.3, 0.2),)) for m in log.measurements))
    table = WirelessLog(
        tuple(replace(m, receiver="beta", transmitter="alpha") for m in written(log, 10**6, 0.001).measurements)
    )
    assert each_once([("table", table), ("bag", bearings)]).measurements == bearings.measurements


def test_two_radios_side_by_side_are_two(caplog: pytest.LogCaptureFixture) -> None:
    """Read out at the same ticks, to the centimetre, with their own noise."""
    one = written(heard(), 10**8, 0.01)
    rng = np.random.default_rng(1)
    other = WirelessLog(tuple(replace(m, range_m=(m.range_m or 0) + rng.normal(0, 0.1)) for m in one.measurements))
    for log in (other, written(other, 10**8, 0.01)):
        assert len(each_once([("one", one), ("other", log)]).measurements) >= 90  # some are equal by chance
    assert caplog.text == ""


@pytest.mark.parametrize(("scale", "offset"), [(0.3048, 0.0), (1.0, 3.0)])
def test_one_log_in_two_units_is_said(scale: float, offset: float, caplog: pytest.LogCaptureFixture) -> None:
    log = heard()
    other = WirelessLog(tuple(replace(m, range_m=scale * (m.range_m or 0) + offset) for m in log.measurements))
    assert len(each_once([("alpha.bag", log), ("uwb.csv", other)]).measurements) == 100
    said = (
        f"alpha.bag and uwb.csv hold 50 measurements of alpha and beta at the same times, with ranges {scale:.4g} times"
    )
    assert said in caplog.text
    assert f"{offset:.2f} m more in the second" in caplog.text


def test_records_that_are_equal_count_once_without_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    log = heard() + WirelessLog(headings=(Heading(START_NS, "alpha", 0.1, 0.05),))
    assert each_once([("alpha.bag", log), ("beta.bag", log), ("radio.jsonl", log)]) == log
    assert each_once([]) == WirelessLog()
    assert caplog.text == ""
