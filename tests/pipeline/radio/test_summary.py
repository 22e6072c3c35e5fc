from __future__ import annotations

import math

from wiclosure.pipeline.radio.summary import pair_summaries
from wiclosure.types import AoaPath, WirelessLog, WirelessMeasurement


def heard(seconds: float, receiver: str, transmitter: str, range_m: float | None, sigma_m: float | None = None):
    paths = (AoaPath(0.5, 0.1),) if range_m is None else ()
    return WirelessMeasurement(round(seconds * 1e9), receiver, transmitter, range_m, sigma_m, paths)


def test_both_directions_of_a_pair_are_counted_together() -> None:
    log = WirelessLog(
        (
            heard(10.0, "beta", "alpha", 4.0, 0.1),
            heard(12.0, "alpha", "beta", 8.0, 0.3),
            heard(13.0, "alpha", "beta", 6.0, 0.2),
            heard(13.0, "alpha", "beta", None),
            heard(20.0, "alpha", "beta", 5.0, 0.2),
            heard(11.0, "gamma", "alpha", None),
        )
    )
    both, lone = pair_summaries(log)
    assert (both.robots, lone.robots) == (("alpha", "beta"), ("alpha", "gamma"))
    assert (both.ranges, both.bearings, both.first_ns, both.last_ns) == (4, 1, 10 * 10**9, 20 * 10**9)
    assert (both.interval_s, both.longest_gap_s) == (2.0, 7.0)
    assert both.range_quantiles_m == (4.0, 5.5, 8.0)
    assert both.sigma_m == 0.2
    assert (lone.ranges, lone.bearings) == (0, 1)
    assert all(math.isnan(value) for value in (*lone.range_quantiles_m, lone.sigma_m, lone.interval_s))


def test_an_empty_log_has_no_pairs() -> None:
    assert pair_summaries(WirelessLog()) == []
