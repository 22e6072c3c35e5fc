"""Logs with one systematic error, held against a map in which both robots are where they were."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.map_check import (
    AgainstMap,
    Contradiction,
    Fit,
    MapOdds,
    held_against,
    held_against_map,
)
from wiclosure.pipeline.mutual_check.map_evidence import MergedPair
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import (
    Closure,
    FloatArray,
    Heading,
    KeyframeId,
    Stage,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.config import AlignmentSettings

CORNERS = {
    "a": [(0, 0), (60, 5), (70, 45), (15, 50), (5, 15)],
    "b": [(75, 40), (25, 48), (2, 20), (40, 3), (66, 12)],
}
SETTINGS, ALIGNMENT = MutualCheckSettings(), AlignmentSettings()


def path(robot: str) -> Trajectory:
    """A metre a second from corner to corner."""
    points = np.array(CORNERS[robot], float)
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    s = np.arange(0.0, way[-1])
    x, y = (np.convolve(np.pad(np.interp(s, way, c), 3, mode="edge"), np.ones(7) / 7, "valid") for c in points.T)
    poses = se3.from_yaw(np.arctan2(np.gradient(y), np.gradient(x)), np.column_stack([x, y, 0 * s]))
    return Trajectory(robot, 10**18 + np.arange(len(s)) * 10**9, poses)


MERGED = {robot: path(robot) for robot in CORNERS}
NEAR = np.argwhere(np.linalg.norm(MERGED["a"].positions[:, None] - MERGED["b"].positions, axis=2) < 6.0)[::8]


def heard(seed: int) -> WirelessLog:
    return simulate_wireless_from_poses(MERGED, RadioSettings(every_m=4.0, direction="one-way", paths=2), seed=seed)


def accepted(i: int, j: int) -> Closure:
    T = se3.between(MERGED["a"].poses[i], MERGED["b"].poses[j])
    closure = Closure.from_measurement(KeyframeId("a", i), KeyframeId("b", j), T, np.eye(6) * 1e-4)
    return closure.accepted(Stage.ESTIMATE)


CLOSURES = [accepted(int(i), int(j)) for i, j in NEAR]


def found(log: WirelessLog, merged: dict[str, Trajectory] = MERGED) -> Contradiction | None:
    return held_against_map(merged, CLOSURES, log, ALIGNMENT, SETTINGS).contradicted.get(("a", "b"))


def each(change: Callable[[WirelessMeasurement], WirelessMeasurement]) -> Callable[[WirelessLog], WirelessLog]:
    return lambda log: replace(log, measurements=tuple(map(change, log.measurements)))


def turned(sign: int, degrees: float) -> Callable[[WirelessLog], WirelessLog]:
    def change(azimuth: float) -> float:
        return float(se3.wrap_angle(np.array(sign * azimuth + np.radians(degrees))))

    return each(lambda m: replace(m, paths=tuple(replace(p, azimuth=change(p.azimuth)) for p in m.paths)))


def longer(factor: float, metres: float) -> Callable[[WirelessLog], WirelessLog]:
    return each(lambda m: m if m.range_m is None else replace(m, range_m=factor * m.range_m + metres))


FAULTS = {
    "clockwise, not": turned(-1, 0.0),
    "from the left axis": turned(1, -90.0),
    "reversed: they": turned(1, 180.0),
    "off by 20 degrees counter-clockwise": turned(1, 20.0),
    "in feet": longer(3.28, 0.0),
    "ranges are 3.0 m too long": longer(1.0, 3.0),
    "ranges are 24.0 m too long": longer(1.0, 24.0),
    "61 % too long for the odometry": longer(1.6, 0.0),
    "s ahead": each(lambda m: replace(m, transmitter_stamp_ns=m.stamp_ns + (2 if m.receiver == "b" else -2) * 10**9)),
    "ahead of those of the scans": each(lambda m: replace(m, stamp_ns=m.stamp_ns + 3 * 10**9)),
    "twice the distance": longer(2.0, 0.0),
    "in body axes": each(lambda m: replace(m, aoa_frame="odometry")),
    "names seem to be swapped": each(lambda m: replace(m, receiver=m.transmitter, transmitter=m.receiver)),
    "10 times too small": each(lambda m: replace(m, range_sigma_m=(m.range_sigma_m or 1.0) / 10)),
}


@pytest.mark.parametrize("seed", range(3))
def test_an_honest_log_is_not_contradicted(seed: int) -> None:
    against = held_against_map(MERGED, CLOSURES, heard(seed), ALIGNMENT, SETTINGS)
    assert against == AgainstMap(fitting=frozenset({("a", "b")}))


@pytest.mark.slow
@pytest.mark.parametrize("every_m", [2.0, 4.0, 8.0])
@pytest.mark.parametrize("direction", ["one-way", "reciprocal"])
def test_no_honest_log_of_many_is_contradicted(every_m: float, direction: Literal["one-way", "reciprocal"]) -> None:
    """Sparse and dense, one-way and both ways, with ranges as far off as calibration leaves them."""
    radio = RadioSettings(every_m=every_m, direction=direction, paths=2)
    logs = [simulate_wireless_from_poses(MERGED, radio, seed=seed) for seed in range(8)]
    contradicted = [found(longer(1.0, off_m)(log)) for log in logs for off_m in (-0.3, 0.0, 0.3)]
    assert contradicted == [None] * 24


@pytest.mark.parametrize("words", FAULTS)
def test_each_error_is_named_with_its_size(words: str) -> None:
    contradicted = found(FAULTS[words](heard(2)))
    assert contradicted is not None
    assert words in contradicted.causes[0].fault
    assert contradicted.log_odds > np.log(SETTINGS.decisive_odds)
    assert str(contradicted).endswith(contradicted.likely)


@pytest.mark.parametrize("usual", [longer(1.0, 0.4), turned(1, 4.0), longer(1.01, 0.0)])
def test_errors_as_large_as_calibration_leaves_them_are_no_fault(
    usual: Callable[[WirelessLog], WirelessLog],
) -> None:
    assert found(usual(heard(2))) is None


def test_a_map_that_is_wrong_is_said_to_contradict_the_radio() -> None:
    elsewhere = MERGED["b"].moved(se3.from_yaw(2.0, np.array([60.0, -45.0, 0.0])))
    contradicted = found(heard(1), {"a": MERGED["a"], "b": elsewhere})
    assert contradicted is not None
    assert contradicted.causes == ()
    assert "may be at fault, or closures" in str(contradicted)


def test_a_compass_that_is_turned_is_named() -> None:
    def headings(off: FloatArray) -> tuple[Heading, ...]:
        return tuple(
            Heading(int(t), robot, float(se3.wrap_angle(np.array(yaw + off[n]))), 0.05)
            for n, (robot, one) in enumerate(MERGED.items())
            for t, yaw in zip(one.stamps_ns[::5], se3.yaw(one.poses[::5]), strict=True)
        )

    log = heard(1)
    assert found(replace(log, headings=headings(np.array([0.3, 0.3])))) is None
    contradicted = found(replace(log, headings=headings(np.array([0.3, 0.8]))))
    assert contradicted is not None
    assert "headings of the compasses" in contradicted.causes[0].fault


def test_odometry_far_from_the_closures_excuses_what_drift_explains() -> None:
    log = longer(1.0, 3.0)(heard(1))
    near = MergedPair(("a", "b"), MERGED, {"a": NEAR[:, 0], "b": NEAR[:, 1]}, ALIGNMENT)
    far = replace(near, tied={"a": NEAR[:1, 0], "b": NEAR[:1, 1]}, alignment=ALIGNMENT)
    weak = replace(far, alignment=ALIGNMENT.model_copy(update={"drift_inflation": 100.0}))
    assert isinstance(held_against(near, log, SETTINGS), Contradiction)
    assert held_against(weak, log, SETTINGS) is Fit.OPEN
    assert abs(weak.log_evidences([log], [False])[0]) < 1.0  # says next to nothing


@pytest.mark.parametrize("seed", range(4))
def test_standard_deviations_too_small_show_beside_drift_that_exceeds_them(seed: int) -> None:
    settings = RadioSettings(every_m=2.0, direction="reciprocal", paths=2)
    honest = simulate_wireless_from_poses(MERGED, settings, seed=seed)
    far = MergedPair(("a", "b"), MERGED, {"a": NEAR[:1, 0], "b": NEAR[:1, 1]}, ALIGNMENT)
    told = held_against(far, FAULTS["10 times too small"](honest), SETTINGS)
    assert isinstance(told, Contradiction)
    assert "times too small" in told.causes[0].fault
    assert not isinstance(held_against(far, honest, SETTINGS), Contradiction)


def test_robots_that_nothing_holds_in_the_map_are_not_judged() -> None:
    assert held_against_map(MERGED, [], longer(3.28, 0.0)(heard(1)), ALIGNMENT, SETTINGS) == AgainstMap()


def test_all_readings_at_once_are_weighed_as_one_by_one() -> None:
    pair = MergedPair(("a", "b"), MERGED, {"a": NEAR[:, 0], "b": NEAR[:, 1]}, ALIGNMENT)
    logs = [heard(1), *(spoil(heard(1)) for spoil in FAULTS.values())]
    assert pair.log_evidences(logs, [False] * len(logs)) == pytest.approx(
        [float(pair.log_evidences([log], [False])[0]) for log in logs], rel=1e-6
    )


@pytest.mark.parametrize("seed", range(3))
def test_bearings_that_say_little_name_an_error_beside_exact_ranges(seed: int) -> None:
    """Ranges of 10 cm are spoilt by odometry's drift at once, bearings of 10 degrees are not."""
    exact = RadioSettings(every_m=10.0, direction="one-way", paths=2, range_sigma_m=0.1)
    log = simulate_wireless_from_poses(MERGED, exact, seed=seed)
    far = [NEAR[0], NEAR[-1]]
    closures = [accepted(int(i), int(j)) for i, j in far]
    assert held_against_map(MERGED, closures, log, ALIGNMENT, SETTINGS).contradicted == {}
    contradicted = held_against_map(MERGED, closures, turned(-1, 0.0)(log), ALIGNMENT, SETTINGS).contradicted["a", "b"]
    assert "clockwise, not" in contradicted.causes[0].fault


@pytest.mark.parametrize(("spoil", "verdict"), [(longer(1.0, 0.0), Fit), (longer(1.0, 3.0), Contradiction)])
def test_a_log_is_cleared_and_accused_from_the_same_odds_on(
    spoil: Callable[[WirelessLog], WirelessLog], verdict: type[Fit | Contradiction]
) -> None:
    log, pair = spoil(heard(2)), MergedPair(("a", "b"), MERGED, {"a": NEAR[:, 0], "b": NEAR[:, 1]}, ALIGNMENT)
    log_odds = MapOdds.of(pair, log, SETTINGS).log_odds
    assert (log_odds > 0) == (verdict is Contradiction)

    def told(decisive: float) -> Contradiction | Fit:
        return held_against(pair, log, SETTINGS.model_copy(update={"decisive_odds": float(np.exp(decisive))}))

    just_decided = told(abs(log_odds) - 0.01)
    assert isinstance(just_decided, Contradiction) or just_decided is Fit.GOOD
    assert isinstance(just_decided, verdict)
    assert told(abs(log_odds) + 0.01) is Fit.OPEN
