from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.radio.check.geometry import pair_samples
from wiclosure.pipeline.radio.check.ranges import check_ranges, step_ratio
from wiclosure.types import Trajectory, WirelessMeasurement

STAMPS_NS = 10**18 + np.arange(200) * 10**9


def walk(robot: str, seed: int) -> Trajectory:
    """A winding walk at 1 m/s, a pose a second."""
    rng = np.random.default_rng(seed)
    heading = rng.uniform(0, 6) + np.cumsum(rng.normal(0, 0.3, len(STAMPS_NS)))
    steps = np.column_stack([np.cos(heading), np.sin(heading), 0 * heading])
    return Trajectory(robot, STAMPS_NS, se3.from_yaw(heading, np.cumsum(steps, axis=0) + np.array([10.0 * seed, 0, 0])))


PATHS = {"a": walk("a", 1), "b": walk("b", 2)}
TRUE_M = np.linalg.norm(PATHS["a"].positions - PATHS["b"].positions, axis=1)
NOISE = np.random.default_rng(0).normal(size=len(TRUE_M))


def checked(ranges, sigma=0.1, unit="m"):
    log = [
        WirelessMeasurement(int(t), "a", "b", float(r), sigma)
        for t, r in zip(STAMPS_NS, np.maximum(ranges, 0.0), strict=True)
    ]
    return check_ranges(pair_samples(log)["a", "b"], PATHS, unit=unit)


def by_topic(check):
    return {finding.topic: finding for finding in check.findings}


@pytest.mark.parametrize("factor", [1.0, 10.0])
def test_ranges_along_a_line_change_as_much_as_the_robots_travel(factor):
    """Robots that drive apart on one line: the bound is met exactly."""
    a = np.column_stack([-np.arange(20.0), np.zeros((20, 2))])
    b = np.column_stack([2 * np.arange(20.0), np.zeros((20, 2))])
    ratio, steps = step_ratio(a, b, factor * np.arange(20.0) * 3)
    assert ratio == pytest.approx(factor)
    assert steps == 19


def test_robots_that_stand_still_make_no_steps():
    ratio, steps = step_ratio(np.zeros((20, 3)), np.ones((20, 3)), np.arange(20.0))
    assert np.isnan(ratio)
    assert steps == 0


def test_ranges_that_fit_are_good():
    check = checked(TRUE_M + 0.1 * NOISE)
    assert {topic: finding.level for topic, finding in by_topic(check).items()} == {"unit": "good", "fit": "good"}
    assert check.fit.rms_m < 0.2


@pytest.mark.parametrize(("factor", "unit"), [(1000, "mm"), (100, "cm"), (1 / 0.3048, "ft")])
def test_ranges_in_another_unit_are_told_and_go_no_further(factor, unit):
    check = checked((TRUE_M + 0.1 * NOISE) * factor)
    (finding,) = check.findings
    assert (finding.topic, finding.level, dict(finding.settings)) == ("unit", "suspect", {"unit": unit})
    assert check.fit is None


def test_the_unit_is_told_relative_to_how_the_log_was_read():
    """Metres, read as centimetres."""
    assert dict(by_topic(checked((TRUE_M + 0.1 * NOISE) / 100, unit="cm"))["unit"].settings) == {"unit": "m"}


def test_jumps_that_no_robot_made_are_counted():
    ranges = TRUE_M.copy()
    ranges[50::50] += 20.0
    finding = by_topic(checked(ranges))["steps"]
    assert finding.level == "note"
    assert finding.text.startswith("6 of 199 ranges change by more")  # there and back, three times


def test_ranges_of_other_robots_fit_nowhere():
    finding = by_topic(checked(TRUE_M[::-1].copy()))["fit"]
    assert finding.level == "suspect"
    assert "no placement of the two paths agrees" in finding.text


def test_a_sigma_that_is_stated_too_large_is_advised():
    finding = by_topic(checked(TRUE_M + 0.1 * NOISE, sigma=1.0))["noise"]
    assert finding.settings["range_sigma"] == pytest.approx(0.1, abs=0.03)


def test_one_range_says_nothing():
    log = [WirelessMeasurement(int(STAMPS_NS[0]), "a", "b", 5.0, 0.1)]
    assert check_ranges(pair_samples(log)["a", "b"], PATHS).findings == ()
