from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.mutual_check.readings import Apart, Reading, readings
from wiclosure.types import AoaPath, Heading, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.faults.corrections import azimuths_off, clocks_apart, ranges_off

BEARING = WirelessMeasurement(
    1_000_000_000, "a", "b", 12.0, 0.3, (AoaPath(0.4, 0.1), AoaPath(-2.0, 0.1)), transmitter_stamp_ns=1_000_000_000
)
RANGE = WirelessMeasurement(2_000_000_000, "b", "a", 7.0, 0.3, transmitter_stamp_ns=2_000_000_000)
LOG = WirelessLog((BEARING, RANGE), (Heading(0, "a", 0.1, 0.05),))
TRAJECTORIES = {
    robot: Trajectory(robot, np.arange(4) * 10**9, se3.from_yaw(np.zeros(4), np.arange(12.0).reshape(4, 3)))
    for robot in ("a", "b")
}


def reading_with(words: str, log: WirelessLog = LOG) -> Reading:
    return next(r for r in readings("a", "b", log) if any(words in c.fault for c in r.corrections))


@pytest.mark.parametrize("log", [LOG, WirelessLog((RANGE,)), replace(LOG, headings=())])
def test_every_correction_changes_what_it_is_given_and_has_a_sentence(log: WirelessLog) -> None:
    for reading in readings("a", "b", log):
        assert reading.corrections
        for correction in reading.corrections:
            trajectories, corrected = correction.apply((TRAJECTORIES, log))
            assert correction.fault
            moved = any(
                not np.array_equal(trajectories[robot].poses, TRAJECTORIES[robot].poses) for robot in TRAJECTORIES
            )
            assert (corrected == log and moved) if not correction.of_log else corrected != log


def test_errors_of_unknown_size_are_tried_on_both_sides() -> None:
    for words in ("clock of b", "m too long", "% too long for the odometry", "mounted turned"):
        assert len(reading_with(words).corrections) >= 16
        assert not reading_with(words).changes_alignment
    tried = {correction.fault for reading in readings("a", "b", LOG) for correction in reading.corrections}
    for correction in (clocks_apart("b", -0.75), clocks_apart("b", 2.0), ranges_off(3.0), azimuths_off(np.radians(20))):
        assert correction.fault in tried


@pytest.mark.parametrize("bias_m", [-31.0, -7.5, 12.0, 40.0])
def test_ranges_wrong_by_any_length_or_factor_are_tried_where_closures_tell_the_distance(bias_m: float) -> None:
    distance_m = np.linspace(35.0, 60.0, 9)
    off = Apart(np.append(distance_m + bias_m, 90.0), np.append(distance_m, 10.0))  # the last one came over a wall
    scaled = Apart(distance_m * 2.5, distance_m)
    tried = {apart: readings("a", "b", LOG, apart=apart) for apart in (off, scaled)}
    assert ranges_off(bias_m).fault in {c.fault for r in tried[off] for c in r.corrections}
    assert any("150 % too long for the odometry" in c.fault for r in tried[scaled] for c in r.corrections)
    ranges = [r for r in tried[off] if "ranges are" in r.corrections[0].fault and r.sigmas]
    assert len(ranges) == 2
    for reading in ranges:  # those that were not tried had a share beforehand
        assert 0.4 < np.exp(reading.log_shares).sum() < 1.0


def test_each_order_of_magnitude_is_equally_likely_but_of_angles_all_are() -> None:
    clocks = reading_with("clock of b")
    shares = np.exp(clocks.log_shares)
    assert shares.sum() == pytest.approx(1.0)
    ahead = np.array([s for s in np.arange(-4.0, 4.25, 0.25) if s])
    assert shares * np.abs(ahead) == pytest.approx(shares[0] * 4.0)
    assert np.ptp(reading_with("mounted turned").log_shares) == 0


def test_what_a_log_does_not_have_cannot_be_wrong() -> None:
    faults = [c.fault for r in readings("a", "b", WirelessLog((RANGE,))) for c in r.corrections]
    assert not any("azimuth" in fault or "direction" in fault or "compass" in fault for fault in faults)
    assert not any("standard deviations" in fault for fault in faults)


def test_parts_of_a_log_that_may_be_wrong_are_left_out() -> None:
    (of_ranges,) = reading_with("directions of arrival are wrong").corrections
    (ranged, other) = of_ranges.apply((TRAJECTORIES, LOG))[1].measurements
    assert (ranged.range_m, ranged.paths, other) == (12.0, (), RANGE)
    (of_directions,) = reading_with("ranges are wrong").corrections
    (directed,) = of_directions.apply((TRAJECTORIES, LOG))[1].measurements
    assert (directed.range_m, directed.paths) == (None, BEARING.paths)


def test_ranges_that_are_a_tenth_short_are_stretched_by_one_of_the_scales() -> None:
    lengths = [
        m.range_m
        for correction in reading_with("% too short for the odometry").corrections
        for m in correction.apply((TRAJECTORIES, LOG))[1].measurements[:1]
    ]
    assert min(abs(length - 12.0 / 0.9) for length in lengths if length is not None) < 0.15
