"""A log against trajectories: each fault is told with its key, and nothing is told of what the data do not show."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.pipeline.radio.check.check import CheckResult, check_log
from wiclosure.pipeline.radio.check.range_fit import fit_ranges
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import Trajectory, WirelessLog, WirelessMeasurement

START_S = 1_700_000_000
RADIO = RadioSettings(
    every_m=None, every_s=1.0, range_sigma_m=0.1, azimuth_sigma_deg=8.0, direction="reciprocal", gross_ranges=0.0
)
Change = Callable[[WirelessMeasurement], WirelessMeasurement]


def winding(robot: str, seed: int, seconds: int = 180) -> Trajectory:
    """A walk at 1 m/s that turns this way and that, 10 poses a second."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(seconds * 10) * 0.1
    yaw = rng.uniform(0, 6) + np.cumsum(0.6 * np.sin(time_s * rng.uniform(0.15, 0.4) + rng.uniform(0, 6))) * 0.1
    steps = 0.1 * np.column_stack([np.cos(yaw), np.sin(yaw), 0 * yaw])
    rotation = Rotation.from_rotvec(np.column_stack([0 * yaw, 0 * yaw, yaw])).as_matrix()
    stamps_ns = START_S * 10**9 + np.arange(len(yaw)) * 10**8
    return Trajectory(
        robot, stamps_ns, se3.from_rotation_translation(rotation, np.cumsum(steps, 0) + np.array([9 * seed, 4, 0]))
    )


def in_own_frame(trajectory: Trajectory, yaw: float) -> Trajectory:
    T = se3.from_rotation_translation(Rotation.from_rotvec([0, 0, yaw]).as_matrix(), np.array([3.0, -7.0 * yaw, 0.5]))
    return trajectory.moved(T)


TRUTH = {robot: winding(robot, seed) for seed, robot in enumerate(("alpha", "beta"), start=1)}
ODOMETRY = {robot: in_own_frame(path, 1.0 + number) for number, (robot, path) in enumerate(TRUTH.items())}
LOG = simulate_wireless_from_poses(TRUTH, RADIO, 0)


def changed(change: Change) -> WirelessLog:
    return WirelessLog(tuple(map(change, LOG.measurements)))


def times(factor: float) -> Change:
    return lambda m: m if m.range_m is None else replace(m, range_m=m.range_m * factor)


def turned(change: Callable[[float], float]) -> Change:
    return lambda m: replace(
        m, paths=tuple(replace(p, azimuth=math.remainder(change(p.azimuth), math.tau)) for p in m.paths)
    )


def later(seconds: float) -> Change:
    return lambda m: replace(m, stamp_ns=m.stamp_ns + round(seconds * 1e9))


def suspects(result: CheckResult) -> Mapping[str, object]:
    return dict(result.settings)


def test_a_good_log_raises_no_suspicion() -> None:
    result = check_log(LOG, ODOMETRY)
    assert not [finding for finding in result.findings if finding.level == "suspect"]
    assert {finding.topic for finding in result.findings if finding.level == "good"} == {
        "unit", "fit", "clock", "bearing"
    }  # fmt: skip


@pytest.mark.parametrize(
    ("change", "settings"),
    [
        (times(1000.0), {"unit": "mm"}),
        (times(100.0), {"unit": "cm"}),
        (times(1 / 0.3048), {"unit": "ft"}),
        (times(0.001), {"unit": "km"}),
        (turned(lambda azimuth: -azimuth), {"clockwise": True}),
        (turned(lambda azimuth: azimuth - math.pi / 2), {"azimuth_zero": "left"}),
        (turned(lambda azimuth: math.pi - azimuth), {"clockwise": True, "azimuth_zero": "back"}),
        (later(-2 * 3600), {"time_offset": 7200}),
        (later(5.5 * 3600), {"time_offset": -19800}),
    ],
)
def test_a_fault_is_told_with_the_key_that_corrects_it(change: Change, settings: dict[str, object]) -> None:
    assert suspects(check_log(changed(change), ODOMETRY)) == settings


def test_a_clock_that_is_seconds_off() -> None:
    assert suspects(check_log(changed(later(2.3)), ODOMETRY)) == {"time_offset": pytest.approx(-2.3, abs=0.1)}


def test_a_unit_that_was_stated_wrongly() -> None:
    assert suspects(check_log(changed(times(0.3048)), ODOMETRY, RadioSource(topic="/r", unit="ft"))) == {"unit": "m"}


@pytest.mark.parametrize(("factor", "unit"), [(10**9, "ns"), (10**3, "ms")])
def test_stamps_of_another_unit(factor: int, unit: str) -> None:
    short = {
        robot: replace(path, stamps_ns=path.stamps_ns - START_S * 10**9 + 5 * 10**11)
        for robot, path in ODOMETRY.items()
    }
    log = changed(lambda m: replace(m, stamp_ns=(m.stamp_ns - START_S * 10**9 + 5 * 10**11) * factor))
    assert suspects(check_log(log, short)) == {"stamp_unit": unit}


def test_corrections_are_laid_over_what_is_stated() -> None:
    stated = RadioSource(topic="/r", clockwise=True, azimuth_zero="left", time_offset=1.0)
    raw = changed(turned(lambda azimuth: azimuth - math.pi))  # counts to the left, from behind
    read = WirelessLog(tuple(turned(lambda azimuth: math.pi / 2 - azimuth)(later(1.0)(m)) for m in raw.measurements))
    found = suspects(check_log(read, ODOMETRY, stated))
    assert found == {"time_offset": pytest.approx(0.0, abs=0.1), "clockwise": False, "azimuth_zero": "back"}


def test_stamps_since_a_start_up() -> None:
    found = suspects(check_log(changed(later(-START_S)), ODOMETRY))
    assert found == {"time_offset": pytest.approx(START_S, abs=1)}


def test_bearings_in_fixed_axes() -> None:
    log = simulate_wireless_from_poses(TRUTH, RADIO.model_copy(update={"aoa_frame": "odometry"}), 0)
    as_body = WirelessLog(tuple(replace(m, aoa_frame="body") for m in log.measurements))
    assert suspects(check_log(as_body, ODOMETRY)) == {"aoa_frame": "odometry"}


def standing(path: Trajectory) -> Trajectory:
    return replace(path, poses=np.repeat(path.poses[:1], len(path), axis=0))


def test_robots_that_stand_still_tell_nothing() -> None:
    still, parked = ({robot: standing(path) for robot, path in paths.items()} for paths in (ODOMETRY, TRUTH))
    fixed = simulate_wireless_from_poses(parked, RADIO.model_copy(update={"bearings": False}), 0)
    for log in (fixed, WirelessLog(tuple(map(times(1000.0), fixed.measurements)))):
        result = check_log(log, still)
        assert not suspects(result)
        assert "motion" in {finding.topic for finding in result.findings}


def test_wrong_robots_fit_nowhere() -> None:
    others = {"alpha": ODOMETRY["alpha"], "beta": in_own_frame(winding("beta", 7), 0.3)}
    topics = {f.topic for f in check_log(LOG, others).findings if f.level == "suspect"}
    assert "fit" in topics


def test_gaps_and_held_values() -> None:
    kept = [m for m in LOG.measurements if not 40 < m.stamp_ns * 1e-9 - START_S < 90]
    gaps = [f.text for f in check_log(WirelessLog(tuple(kept)), ODOMETRY).findings if f.topic == "gaps"]
    assert len(gaps) == 1
    assert "1 gaps" in gaps[0]
    held = [replace(m, range_m=LOG.measurements[i - i % 4].range_m) for i, m in enumerate(LOG.measurements)]
    found = check_log(WirelessLog(tuple(held)), ODOMETRY).findings
    assert [f.level for f in found if f.topic == "repeated"] == ["suspect"]


def test_nothing_in_common() -> None:
    with pytest.raises(InputError, match="map the ids with robots"):
        check_log(LOG, {"7": ODOMETRY["alpha"], "12": ODOMETRY["beta"]})
    with pytest.raises(InputError, match="no measurements"):
        check_log(WirelessLog(), ODOMETRY)


def test_perfect_ranges_give_the_frames_back() -> None:
    a, b = (ODOMETRY[robot].positions[::20] for robot in ("alpha", "beta"))
    true = np.linalg.norm(TRUTH["alpha"].positions[::20] - TRUTH["beta"].positions[::20], axis=1)
    fit = fit_ranges(a, b, true * 7.0, None)
    assert fit is not None
    assert (fit.scale, fit.rms_m) == (pytest.approx(1 / 7, rel=1e-4), pytest.approx(0.0, abs=1e-3))
