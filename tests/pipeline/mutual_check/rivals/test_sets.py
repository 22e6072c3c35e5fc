"""Closures of places that look alike, beside the true ones, and a log that tells them apart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.mutual_check.rivals.sets import weigh_rivals, without_lost
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import Closure, KeyframeId, Stage, Trajectory, WirelessLog, WirelessMeasurement

SIGMA = np.repeat([0.005, 0.05], 3)
STEPS = np.arange(160)
SHIFT_M = {"true": 0.0, "look alike": 30.0}

Spoil = Callable[[WirelessMeasurement], WirelessMeasurement]


def driven(robot: str, x: np.ndarray, y: np.ndarray) -> Trajectory:
    """A metre or so a second, along its heading."""
    poses = se3.from_yaw(np.arctan2(np.gradient(y), np.gradient(x)), np.column_stack([x, y, 0 * x]))
    return Trajectory(robot, 10**18 + STEPS * 10**9, poses)


@pytest.fixture(scope="module")
def team() -> dict[str, Trajectory]:
    return {
        "a": driven("a", STEPS * 0.8, 12 * np.sin(STEPS / 18)),
        "b": driven("b", 130 - STEPS * 0.7, 10 * np.cos(STEPS / 25)),
    }


@pytest.fixture(scope="module")
def log(team: dict[str, Trajectory]) -> WirelessLog:
    return simulate_wireless_from_poses(team, RadioSettings(every_m=6.0, direction="one-way", paths=2), seed=2)


def closures(team: dict[str, Trajectory], kind: str, count: int) -> list[Closure]:
    """Between places that are near each other, or would be if b's were shifted."""
    rng, (T_a, T_b) = np.random.default_rng(count), (team[robot].poses.copy() for robot in "ab")
    T_b[:, 0, 3] += SHIFT_M[kind]
    near = rng.permutation(np.argwhere(np.linalg.norm(T_a[:, None, :3, 3] - T_b[None, :, :3, 3], axis=2) < 8.0))
    return [
        Closure.from_measurement(
            KeyframeId("a", i),
            KeyframeId("b", j),
            se3.between(T_a[i], T_b[j]) @ se3.exp(rng.normal(size=6) * SIGMA),
            np.diag(SIGMA**2),
        )
        for i, j in near[:count].tolist()
    ]


FAULTS: dict[str, Spoil] = {
    "honest": lambda m: m,
    "feet": lambda m: replace(m, range_m=None if m.range_m is None else 3.28 * m.range_m),
    "3 m too long": lambda m: replace(m, range_m=None if m.range_m is None else m.range_m + 3.0),
    "clockwise": lambda m: replace(m, paths=tuple(replace(p, azimuth=-p.azimuth) for p in m.paths)),
}


@pytest.mark.parametrize(
    ("fault", "kept"),
    [("honest", "look alike"), ("feet", "true"), ("3 m too long", "look alike"), ("clockwise", "true")],
)
def test_of_two_sets_the_one_that_fits_the_log_is_kept_whatever_is_wrong_with_it(
    team: dict[str, Trajectory], log: WirelessLog, fault: str, kept: str
) -> None:
    """The log is that of the shifted paths, or of the true ones: which set is larger does not matter."""
    shifted = {**team, "b": Trajectory("b", team["b"].stamps_ns, team["b"].poses + _along_x(SHIFT_M[kept]))}
    heard = simulate_wireless_from_poses(shifted, RadioSettings(every_m=6.0, direction="one-way", paths=2), seed=2)
    spoilt = replace(heard, measurements=tuple(map(FAULTS[fault], heard.measurements)))
    found = [*closures(team, "true", 11), *closures(team, "look alike", 10)]
    checked = pairwise_consistent(found, team)
    assert not any(c.live for c in checked.closures)

    (rivals,) = weigh_rivals(checked, team, spoilt, Config())
    right = set(range(11)) if kept == "true" else set(range(11, 21))
    assert (set(rivals.kept), set(rivals.lost)) == (right, set(range(21)) - right)
    left = without_lost(found, [rivals])
    assert {row for row, c in enumerate(left) if c.rejected_at is Stage.RADIO_CHECK} == set(rivals.lost)
    accepted = pairwise_consistent(left, team, supported=rivals.kept).closures
    assert {row for row, c in enumerate(accepted) if c.live} == right
    assert rivals.decides
    assert f"speaks for the {len(right)}" in rivals.sentence


def _along_x(metres: float) -> np.ndarray:
    off = np.zeros((4, 4))
    off[0, 3] = metres
    return off


def test_nothing_is_weighed_where_one_set_is_left_or_nothing_was_measured(
    team: dict[str, Trajectory], log: WirelessLog
) -> None:
    alone = pairwise_consistent(closures(team, "true", 11), team)
    assert weigh_rivals(alone, team, log, Config()) == []
    two = pairwise_consistent([*closures(team, "true", 11), *closures(team, "look alike", 10)], team)
    assert weigh_rivals(two, team, WirelessLog(), Config()) == []


def test_what_no_measurement_tells_apart_stays_in_doubt(team: dict[str, Trajectory], log: WirelessLog) -> None:
    noise = np.random.default_rng(0)

    def anywhere(m: WirelessMeasurement) -> WirelessMeasurement:
        return replace(m, range_m=float(noise.uniform(0, 100)), paths=())

    found = [*closures(team, "true", 11), *closures(team, "look alike", 10)]
    spoilt = replace(log, measurements=tuple(map(anywhere, log.measurements)))
    (rivals,) = weigh_rivals(pairwise_consistent(found, team), team, spoilt, Config())
    assert not rivals.decides
    assert len(rivals.kept) in {10, 11}
    assert "does not decide: most likely the " in rivals.sentence
    assert without_lost(found, [rivals]) == tuple(found)


@pytest.mark.slow
def test_a_log_whose_units_change_half_way_fits_the_true_set(team: dict[str, Trajectory], log: WirelessLog) -> None:
    half = len(log.measurements) // 2
    spoilt = replace(log, measurements=(*log.measurements[:half], *map(FAULTS["feet"], log.measurements[half:])))
    found = [*closures(team, "true", 10), *closures(team, "look alike", 11)]
    (rivals,) = weigh_rivals(pairwise_consistent(found, team), team, spoilt, Config())
    assert rivals.decides
    assert set(rivals.kept) == set(range(10))
    assert rivals.cause.startswith("from ")
    assert rivals.cause.endswith("s after the first measurement on, ranges seem to be in feet, not in metres")
