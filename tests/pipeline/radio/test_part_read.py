"""What becomes of radio that was measured after the scans that are read."""

from __future__ import annotations

import pytest

from wiclosure.pipeline.radio.part_read import without_later
from wiclosure.types import Heading, WirelessLog, WirelessMeasurement

S = 10**9

LOG = WirelessLog(
    (
        WirelessMeasurement(5 * S, "alpha", "beta", 4.0, 0.5),
        WirelessMeasurement(15 * S, "beta", "alpha", 4.0, 0.5, transmitter_stamp_ns=5 * S),
        WirelessMeasurement(15 * S, "alpha", "beta", 4.0, 0.5),
        WirelessMeasurement(25 * S, "beta", "gamma", 4.0, 0.5),
    ),
    (Heading(5 * S, "alpha", 0.0, 0.1), Heading(15 * S, "alpha", 0.0, 0.1)),
)
ENDS_NS = {"alpha": 10 * S, "beta": 20 * S}


def test_later_radio_of_robots_that_are_read_in_part_is_left_out(caplog: pytest.LogCaptureFixture) -> None:
    kept = without_later(LOG, ENDS_NS, 100)
    assert kept.measurements == LOG.measurements[:2]
    assert kept.headings == LOG.headings[:1]
    assert "2 of 4 radio measurements are later than the 100 scans that are read of each robot" in caplog.text


def test_where_all_of_it_is_later_a_wrong_clock_would_not_show(caplog: pytest.LogCaptureFixture) -> None:
    assert without_later(WirelessLog(LOG.measurements[2:]), ENDS_NS | {"gamma": 20 * S}, 60) == WirelessLog()
    assert "all 2 radio measurements are later than the 60 scans" in caplog.text


def test_of_robots_that_are_read_whole_all_of_it_counts() -> None:
    assert without_later(LOG, {}, 101) == LOG
