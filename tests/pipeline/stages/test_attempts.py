"""Whole runs over a recorded drive as two robots, whose radio log has one systematic error."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest

from wiclosure.interfaces import ScanSource
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.inputs import Inputs, RobotInput
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.run import Prepared, candidate_filter, prepare, run_stages
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import Scan, Stage, Trajectory, WirelessMeasurement

pytestmark = pytest.mark.slow

A, B, START_TOGETHER_NS = np.arange(0, 95, 2), np.arange(61, 154, 2), -6_000_000_000


@dataclass(frozen=True)
class Part:
    """Some scans of a drive."""

    scans: tuple[Scan, ...]
    description: str = "part of a drive"

    def __len__(self) -> int:
        return len(self.scans)

    def __iter__(self):  # type: ignore[no-untyped-def]
        return iter(self.scans)


@pytest.fixture(scope="module")
def prepared(kitti_drive: ScanSource) -> Prepared:
    truth, robots = {}, []
    scans = list(kitti_drive)
    for robot, rows, later_ns in (("alpha", A, 0), ("beta", B, START_TOGETHER_NS)):
        own = tuple(replace(scans[i], stamp_ns=scans[i].stamp_ns + later_ns) for i in rows)
        poses = kitti_drive.poses[rows]  # type: ignore[attr-defined]
        truth[robot] = Trajectory(robot, np.array([scan.stamp_ns for scan in own]), poses)
        robots.append(RobotInput(robot, Part(own), robot, truth[robot]))
    radio = RadioSettings(every_m=4.0, direction="reciprocal", paths=5)
    inputs = Inputs(tuple(robots), simulate_wireless_from_poses(truth, radio, seed=1))
    return prepare(inputs, Config(), cache=StageCache(None), jobs=1, progress=NoProgress())


Change = Callable[[WirelessMeasurement], WirelessMeasurement]


def run_with(prepared: Prepared, change: Change, *, filter_name: str = "wiclosure", enabled: bool = True) -> RunResult:
    wireless = prepared.inputs.wireless
    log = replace(wireless, measurements=tuple(map(change, wireless.measurements)))
    inputs = replace(prepared.inputs, wireless=log)
    check = prepared.config.mutual_check.model_copy(update={"enabled": enabled})
    config = prepared.config.model_copy(update={"mutual_check": check})
    chosen = candidate_filter(filter_name, inputs, config)
    return run_stages(replace(prepared, inputs=inputs, config=config), chosen, progress=NoProgress())


def honest(m: WirelessMeasurement) -> WirelessMeasurement:
    return m


def in_feet(m: WirelessMeasurement) -> WirelessMeasurement:
    assert m.range_m is not None
    return replace(m, range_m=3.28084 * m.range_m)


def ten_metres_long(m: WirelessMeasurement) -> WirelessMeasurement:
    assert m.range_m is not None
    return replace(m, range_m=m.range_m + 10.0)


def late(m: WirelessMeasurement) -> WirelessMeasurement:
    if m.receiver == "alpha":
        return replace(m, transmitter_stamp_ns=m.stamp_ns + 2 * 10**9)
    return replace(m, stamp_ns=m.stamp_ns + 2 * 10**9, transmitter_stamp_ns=m.stamp_ns)


@pytest.mark.parametrize(
    ("change", "cause"), [(in_feet, "in feet"), (late, "clock of beta"), (ten_metres_long, "m too long")]
)
def test_closures_that_agree_overrule_a_wrong_radio_which_is_named(
    prepared: Prepared, change: Change, cause: str
) -> None:
    without = run_with(prepared, change, filter_name="none")
    found = run_with(prepared, change)
    assert [c["robots"] for c in found.metrics["components"]] == [["alpha", "beta"]]
    ate_m, ate_without_m = found.metrics["ate_m"]["team"], without.metrics["ate_m"]["team"]
    assert ate_m is not None
    assert ate_without_m is not None
    assert ate_m <= 1.05 * ate_without_m
    assert found.metrics["closures"]["accepted_false"] == 0
    said = [s for s in found.metrics["diagnosis"] if "the radio is the likely fault" in s]
    assert len(said) == 1
    assert cause in said[0]


def test_an_honest_radio_costs_no_second_round(prepared: Prepared) -> None:
    found, without_check = run_with(prepared, honest), run_with(prepared, honest, enabled=False)
    assert [c["robots"] for c in found.metrics["components"]] == [["alpha", "beta"]]
    assert len(found.solution.closures) == len(without_check.solution.closures)
    assert all(c.survived(Stage.RADIO_CHECK) for c in found.solution.closures if c.rejected_at is None)
    assert not any("likely fault" in sentence for sentence in found.metrics["diagnosis"])
