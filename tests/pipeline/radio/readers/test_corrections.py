from __future__ import annotations

import math

import pytest

from wiclosure.pipeline.radio.readers.corrections import CORRECTIONS, corrected
from wiclosure.pipeline.radio.readers.tag_names import TagNames
from wiclosure.pipeline.radio.source import RadioSource, keys
from wiclosure.types import AoaPath, Heading, WirelessLog, WirelessMeasurement

SECOND_NS = 10**9


def measurement(stamp_s, receiver="1", transmitter="2", range_m=5.0, **more):
    sigma = None if range_m is None else 0.2
    return WirelessMeasurement(stamp_s * SECOND_NS, receiver, transmitter, range_m, sigma, **more)


def correct(log, **settings):
    source = RadioSource.model_validate({"path": "log.jsonl", **settings})
    return corrected(log, source, TagNames(source, None))


def test_settings_are_those_of_sources():
    assert set(keys()) >= CORRECTIONS


def test_a_source_that_states_nothing_leaves_the_log_alone():
    log = WirelessLog((measurement(1),))
    assert correct(log) is log
    assert correct(log, range_limits=[0, 1]) is log


def test_ranges_are_converted_and_keep_their_sigma_in_metres():
    log = WirelessLog((measurement(1, range_m=2500.0), measurement(2, range_m=300.0)))
    found = correct(log, unit="mm", range_offset=-0.5).measurements
    assert [m.range_m for m in found] == [2.0, 0.0]  # no range is negative
    assert [m.range_sigma_m for m in found] == [0.2, 0.2]
    assert [m.range_sigma_m for m in correct(log, range_sigma=0.7).measurements] == [0.7, 0.7]


def test_the_clock_moves_every_stamp_exactly():
    heard = measurement(1_700_000_000, transmitter_stamp_ns=1_700_000_000 * SECOND_NS + 1)
    log = WirelessLog((heard,), (Heading(3 * SECOND_NS, "1", 0.5, 0.1),))
    found = correct(log, time_offset=-0.1)
    assert found.measurements[0].stamp_ns == 1_699_999_999_900_000_000
    assert found.measurements[0].transmitter_stamp_ns == 1_699_999_999_900_000_001
    assert found.headings[0].stamp_ns == 2_900_000_000


def test_robots_are_named_and_anchors_left_out():
    log = WirelessLog((measurement(1), measurement(2, transmitter="9")), (Heading(0, "2", 0.5, 0.1),))
    found = correct(log, robots={1: "alpha", 2: "beta"}, anchors=[9])
    assert [(m.receiver, m.transmitter) for m in found.measurements] == [("alpha", "beta")]
    assert found.headings[0].robot == "beta"


@pytest.mark.parametrize(
    ("settings", "azimuth", "elevation"),
    [
        ({"clockwise": True}, -0.5, 0.25),
        ({"azimuth_zero": "left"}, 0.5 + math.pi / 2, 0.25),
        ({"elevation_zero": "up"}, 0.5, math.pi / 2 - 0.25),
    ],
)
def test_directions_are_turned(settings, azimuth, elevation):
    seen = measurement(1, range_m=None, paths=(AoaPath(0.5, 0.1, elevation=0.25), AoaPath(0.5, 0.1)))
    with_elevation, without = correct(WirelessLog((seen,)), **settings).measurements[0].paths
    assert with_elevation.azimuth == pytest.approx(azimuth)
    assert with_elevation.elevation == pytest.approx(elevation)
    assert without.elevation is None


def test_the_frame_of_directions_is_the_logs_own_unless_stated():
    log = WirelessLog((measurement(1, paths=(AoaPath(0.5, 0.1),), aoa_frame="odometry"),))
    assert correct(log, time_offset=1.0).measurements[0].aoa_frame == "odometry"
    assert correct(log, aoa_frame="world").measurements[0].aoa_frame == "world"


def test_ranges_beyond_the_stated_limit_are_left_out_and_counted(caplog):
    log = WirelessLog((measurement(1), measurement(2, range_m=50.0), measurement(3, range_m=2000.0)))
    assert len(correct(log, max_range=20).measurements) == 1
    assert "log.jsonl: 2 ranges lie beyond max_range and were left out" in caplog.text
    assert len(correct(log, time_offset=1.0).measurements) == 3  # the usual limit is for unknown logs
