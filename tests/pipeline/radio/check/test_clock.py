from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.radio.check.clock import Span, check_clock, check_overlap, common_span
from wiclosure.pipeline.radio.check.geometry import pair_samples
from wiclosure.types import Trajectory, WirelessMeasurement

SECOND_NS = 10**9
START_NS = 1_700_000_000 * SECOND_NS
POSES = Span(START_NS, START_NS + 600 * SECOND_NS)


def log(first_s: float, seconds: float = 500) -> Span:
    return Span(round(first_s * 1e9), round((first_s + seconds) * 1e9))


def test_spans_overlap_where_they_share_a_time():
    assert Span(0, 10).overlaps(Span(10, 20))
    assert not Span(0, 10).overlaps(Span(11, 20))
    assert Span(0, 10).mostly_in(Span(5, 99))
    assert not Span(0, 10).mostly_in(Span(6, 99))


def test_the_common_span_is_from_the_first_pose_to_the_last():
    early = Trajectory("a", np.array([1, 5]) * SECOND_NS, np.tile(np.eye(4), (2, 1, 1)))
    late = Trajectory("b", np.array([3, 9]) * SECOND_NS, np.tile(np.eye(4), (2, 1, 1)))
    assert common_span({"a": early, "b": late}) == Span(SECOND_NS, 9 * SECOND_NS)


def test_a_log_that_shares_a_time_is_left_alone():
    assert check_overlap(log(1_700_000_300), POSES) is None


@pytest.mark.parametrize(
    ("span", "read", "settings"),
    [
        (Span(POSES.first_ns * 1000, POSES.last_ns * 1000), "s", {"stamp_unit": "ms"}),
        (Span(POSES.first_ns // 10**6, POSES.last_ns // 10**6), "ns", {"stamp_unit": "ms"}),
        (Span(POSES.first_ns // 10, POSES.last_ns // 10), "us", {"stamp_unit": "10us"}),
        (log(1_700_000_050 - 2 * 3600), "s", {"time_offset": 7200}),
        (log(1_700_000_050 + 5.5 * 3600), "s", {"time_offset": -19800}),
        (log(12.5), "s", {"time_offset": 1_699_999_987.5}),
        (log(1_700_000_000 - 40 * 86_400), "s", {}),
        (log(1_384_035_268), "s", {"time_offset": 315_964_782}),
        (log(252_868), "s", {"time_offset": 1_699_747_182}),
    ],
    ids=[
        "read as s",
        "read as ns",
        "ticks",
        "two hours",
        "half an hour too",
        "since a start",
        "another day",
        "GPS time",
        "GPS week",
    ],
)
def test_what_explains_that_nothing_overlaps(span, read, settings):
    found = check_overlap(span, POSES, read)
    assert (found.topic, found.level, dict(found.settings)) == ("overlap", "suspect", settings)


# ---------------------------------------------------------------------------------------------------- shift of a clock
def walk(robot: str, seed: int, seconds: int = 20) -> Trajectory:
    """A winding drive at 2 m/s, two poses a second; so short that few shifts keep the ranges inside."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(0, 6) + np.cumsum(rng.normal(0, 0.4, 2 * seconds))
    steps = np.column_stack([np.cos(heading), np.sin(heading), 0 * heading])
    stamps_ns = START_NS + np.arange(2 * seconds) * SECOND_NS // 2
    return Trajectory(robot, stamps_ns, se3.from_yaw(heading, np.cumsum(steps, axis=0) + np.array([5.0 * seed, 0, 0])))


PATHS = {"a": walk("a", 1), "b": walk("b", 2)}


def samples_of(paths, late_s: float, count: int = 24):
    """Ranges, with noise of 0.1 m, whose stamps are `late_s` behind the trajectories'."""
    at_ns = START_NS + np.linspace(1.5 * SECOND_NS, 18 * SECOND_NS, count).astype(np.int64)
    ranges = np.linalg.norm(paths["a"].at(at_ns)[:, :3, 3] - paths["b"].at(at_ns)[:, :3, 3], axis=1)
    ranges += 0.1 * np.random.default_rng(0).normal(size=count)
    measurements = [
        WirelessMeasurement(int(t) + round(late_s * 1e9), "a", "b", float(r), 0.1)
        for t, r in zip(at_ns, ranges, strict=True)
    ]
    return pair_samples(measurements)["a", "b"]


def test_a_shift_of_the_clock_is_found():
    late_s = -1.35
    found, shift_s = check_clock(samples_of(PATHS, late_s), PATHS)
    assert shift_s == pytest.approx(-late_s, abs=0.15)
    assert (found.level, found.pair) == ("suspect", ("a", "b"))
    assert found.settings["time_offset"] == pytest.approx(-late_s, abs=0.15)


def test_a_clock_that_is_right_is_said_to_be():
    found, shift_s = check_clock(samples_of(PATHS, 0.0), PATHS)
    assert (found.level, shift_s, dict(found.settings)) == ("good", 0.0, {})


def test_too_few_ranges_do_not_tell():
    found, shift_s = check_clock(samples_of(PATHS, 0.0, count=15), PATHS)
    assert (found.level, shift_s) == ("note", 0.0)
    assert "too few ranges within both trajectories" in found.text


def test_robots_that_stand_still_do_not_tell():
    still = {
        robot: Trajectory(robot, PATHS[robot].stamps_ns, np.tile(se3.from_yaw(0.0, np.array(place)), (40, 1, 1)))
        for robot, place in (("a", [0.0, 0, 0]), ("b", [3.0, 4, 0]))
    }
    found, shift_s = check_clock(samples_of(still, 1.0), still)
    assert (found.level, shift_s) == ("note", 0.0)
    assert "too even to tell" in found.text
