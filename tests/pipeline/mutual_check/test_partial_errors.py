"""Logs of which a part is wrong, where it is known where the robots were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.map_check import Contradiction, Fit, held_against
from wiclosure.pipeline.mutual_check.map_evidence import MergedPair
from wiclosure.pipeline.mutual_check.partial_errors import Part, PartialErrors
from wiclosure.pipeline.mutual_check.readings import readings_of_log
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import Trajectory, WirelessLog
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.faults.corrections import Correction, ranges_off

T = np.linspace(0.0, 1.0, 60)


def driven(robot: str, x: np.ndarray, y: np.ndarray) -> Trajectory:
    poses = se3.from_yaw(np.arctan2(np.gradient(y), np.gradient(x)), np.column_stack([x, y, 0 * x]))
    return Trajectory(robot, 10**18 + np.arange(len(x)) * 10**9, poses)


TRUTH = {"a": driven("a", 60 * T, 20 * np.sin(5 * T)), "b": driven("b", 50 - 45 * T, 25 + 15 * np.cos(7 * T))}
HONEST = simulate_wireless_from_poses(TRUTH, RadioSettings(every_m=4.0, direction="reciprocal", paths=2), seed=4)
STAMPS = sorted(m.stamp_ns for m in HONEST.measurements)
HALF_WAY_NS = STAMPS[len(STAMPS) // 2]
PARTS = {
    "in what b received": Part("", receiver="b"),
    "after the first measurement on": Part("", since_ns=HALF_WAY_NS),
    "until": Part("", until_ns=HALF_WAY_NS),
}


@pytest.fixture(scope="module")
def merged() -> MergedPair:
    tied = {robot: np.arange(0, len(path), 5) for robot, path in TRUTH.items()}
    return MergedPair(("a", "b"), TRUTH, tied, AlignmentSettings())


def spoilt(part: Part, factor: float = 3.28084, metres: float = 0.0) -> WirelessLog:
    changed = (
        replace(m, range_m=factor * m.range_m + metres) if m.range_m is not None and part.holds(m) else m
        for m in HONEST.measurements
    )
    return replace(HONEST, measurements=tuple(changed))


@pytest.mark.parametrize("clause", PARTS)
@pytest.mark.parametrize(("fault", "factor", "metres"), [("in feet", 3.28084, 0.0), ("3.0 m too long", 1.0, 3.0)])
def test_the_part_and_its_error_are_named(
    merged: MergedPair, clause: str, fault: str, factor: float, metres: float
) -> None:
    told = held_against(merged, spoilt(PARTS[clause], factor, metres), MutualCheckSettings())
    assert isinstance(told, Contradiction)
    assert clause in told.causes[0].fault
    assert fault in told.causes[0].fault


def test_what_is_named_restores_the_part_and_leaves_the_rest(merged: MergedPair) -> None:
    part = PARTS["after the first measurement on"]
    log = spoilt(part)
    told = held_against(merged, log, MutualCheckSettings())
    assert isinstance(told, Contradiction)
    restored = told.causes[0].apply((TRUTH, log))[1].measurements
    assert [m.range_m for m in restored] == pytest.approx([m.range_m for m in HONEST.measurements], rel=0.05)
    assert all(now == was for now, was in zip(restored, log.measurements, strict=True) if not part.holds(was))


def test_an_honest_log_has_no_part_that_is_wrong(merged: MergedPair) -> None:
    assert held_against(merged, HONEST, MutualCheckSettings()) is Fit.GOOD


def test_an_error_of_the_whole_log_is_named_as_such(merged: MergedPair) -> None:
    told = held_against(merged, spoilt(Part("")), MutualCheckSettings())
    assert isinstance(told, Contradiction)
    assert told.causes[0].fault == "ranges seem to be in feet, not in metres"


def test_sums_over_parts_are_as_of_the_log_with_the_part_corrected(merged: MergedPair) -> None:
    log = spoilt(PARTS["in what b received"])
    usual = AlignmentSettings().calibration
    partial = PartialErrors.among(merged, log, readings_of_log("a", "b", log, usual, merged.apart(log)))
    (likeliest, *_) = partial.likeliest(3)
    corrected = likeliest.undone.apply((TRUTH, log))[1]
    whole = float(merged.log_evidences([corrected], [False])[0])
    assert likeliest.log_evidence == pytest.approx(whole + likeliest.log_share, abs=0.5)


def test_one_measurement_has_no_part(merged: MergedPair) -> None:
    one = WirelessLog(HONEST.measurements[:1])
    tried = readings_of_log("a", "b", one, AlignmentSettings().calibration, merged.apart(one))
    assert PartialErrors.among(merged, one, tried).likeliest(3) == []


def test_a_correction_of_a_part_leaves_the_order() -> None:
    shifted: Correction = Part("b's", receiver="b").corrected(ranges_off(3.0))
    changed = shifted.apply((TRUTH, HONEST))[1].measurements
    assert [(m.stamp_ns, m.receiver) for m in changed] == [(m.stamp_ns, m.receiver) for m in HONEST.measurements]
    assert {m.receiver for m, was in zip(changed, HONEST.measurements, strict=True) if m != was} == {"b"}
    assert shifted.fault.startswith("b's, ranges are 3.0 m too long")
