"""Pairs of robots vote on what is wrong with the whole log."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AoaPath, FloatArray, FrameAlignment, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.faults.corrections import Correction
from wiclosure.wiclosure_filter.faults.whole_log import outvoted
from wiclosure.wiclosure_filter.filter import WiClosureFilter

STEPS = 40


def certain(a: str, b: str) -> FrameAlignment:
    return FrameAlignment(a, b, None, None, False, "made for a test")


def doubted(a: str, b: str) -> FrameAlignment:
    return FrameAlignment(a, b, None, None, True, "made for a test", suspected_fault="something")


def fault(name: str, *, whole_log: bool) -> Correction:
    return Correction(name, lambda inputs: inputs, whole_log=whole_log)


def by_pair(*alignments: FrameAlignment) -> dict[tuple[str, str], FrameAlignment]:
    return {(one.robot_a, one.robot_b): one for one in alignments}


def test_one_pair_does_not_outvote_two_that_are_certain() -> None:
    alignments = by_pair(certain("a", "b"), certain("b", "c"), doubted("a", "c"))
    assert outvoted({("a", "c"): fault("feet", whole_log=True)}, alignments) == {}


def test_two_pairs_outvote_one_that_fits_by_chance() -> None:
    alignments = by_pair(certain("a", "b"), doubted("b", "c"), doubted("a", "c"))
    reversed_ = fault("reversed", whole_log=True)
    found = outvoted({("b", "c"): reversed_, ("a", "c"): reversed_}, alignments)
    assert {pair: one.fault for pair, one in found.items()} == dict.fromkeys(alignments, "reversed")


def test_what_may_be_wrong_with_one_pair_is_not_voted_on() -> None:
    alignments = by_pair(certain("a", "b"), certain("b", "c"), doubted("a", "c"))
    clock = {("a", "c"): fault("clock", whole_log=False)}
    assert outvoted(clock, alignments) == clock


def drive(turn_rad: float, start: tuple[float, float]) -> FloatArray:
    yaw = turn_rad * np.arange(STEPS)
    steps = np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw])
    return se3.from_yaw(yaw, np.cumsum(steps, axis=0) + np.array([*start, 0.0]))


def heard(receiver: Trajectory, transmitter: Trajectory, reverse: bool) -> list[WirelessMeasurement]:
    rng = np.random.default_rng(1)
    seen = se3.between(receiver.poses, transmitter.poses)[::2, :3, 3]
    azimuth = np.arctan2(seen[:, 1], seen[:, 0]) + rng.normal(0, 0.05, len(seen)) + (np.pi if reverse else 0.0)
    return [
        WirelessMeasurement(
            int(t), receiver.robot, transmitter.robot, float(np.linalg.norm(p)), 0.3, (AoaPath(float(z), 0.14),)
        )
        for t, p, z in zip(receiver.stamps_ns[::2], seen, se3.wrap_angle(azimuth), strict=True)
    ]


@pytest.mark.parametrize("reverse", [False, True])
def test_a_third_robot_tells_what_two_in_parallel_cannot(reverse: bool) -> None:
    stamps_ns = np.arange(STEPS, dtype=np.int64) * 10**9
    ways = {"a": drive(0.0, (0.0, 0.0)), "b": drive(0.0, (0.0, 8.0)), "c": drive(-0.09, (12.0, 16.0))}
    robots = {name: Trajectory(name, stamps_ns, poses) for name, poses in ways.items()}
    two = {name: robots[name] for name in ("a", "b")}
    between = heard(robots["a"], robots["b"], reverse)
    (alone,) = WiClosureFilter().candidates(two, WirelessLog(tuple(between))).alignments
    assert alone.ambiguous
    whole = WirelessLog(tuple(between + heard(robots["a"], robots["c"], reverse)))
    found = {(one.robot_a, one.robot_b): one for one in WiClosureFilter().candidates(robots, whole).alignments}
    assert found["a", "b"].ambiguous is reverse
    assert found["a", "c"].ambiguous is reverse
