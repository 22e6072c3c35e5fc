"""Measurements outside the odometry's time put an alignment in doubt where a shifted clock fits them as well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AoaPath, FloatArray, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.faults.outside import clocks_in_doubt
from wiclosure.wiclosure_filter.filter import WiClosureFilter

TIMES_S = np.arange(0.0, 91.0, 1.0)
CLOCK_S = 18.0


def driving(yaw: FloatArray, start: tuple[float, float]) -> FloatArray:
    """Poses of a robot at 1 m/s."""
    steps = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros(len(yaw))])
    return se3.from_yaw(yaw, np.array([*start, 0.0]) + np.cumsum(steps, axis=0))


STRAIGHT = {"a": driving(np.zeros(91), (0.0, 0.0)), "b": driving(np.full(91, 0.6), (4.0, 10.0))}
TURNING = {
    "a": driving(0.8 * np.sin(TIMES_S / 9.0), (0.0, 0.0)),
    "b": driving(0.3 - 1.2 * np.sin(TIMES_S / 14.0), (4.0, 10.0)),
}


def heard(truth: dict[str, FloatArray]) -> WirelessLog:
    """Ranges and bearings by a of b, over the whole time."""
    rng, measurements = np.random.default_rng(5), []
    for row in range(0, 91, 4):
        seen = se3.transform(se3.inverse(truth["a"][row]), truth["b"][row, :3, 3])
        azimuth = float(np.arctan2(seen[1], seen[0]) + rng.normal(0.0, 0.01))
        measurements.append(
            WirelessMeasurement(
                stamp_ns=round(TIMES_S[row] * 1e9),
                receiver="a",
                transmitter="b",
                range_m=float(np.linalg.norm(seen) + rng.normal(0.0, 0.05)),
                range_sigma_m=0.05,
                paths=(AoaPath(azimuth=float(se3.wrap_angle(np.asarray(azimuth))), sigma=0.02),),
            )
        )
    return WirelessLog(tuple(measurements))


def in_doubt(truth: dict[str, FloatArray], odometry: dict[str, Trajectory]) -> dict[tuple[str, str], str]:
    """With an alignment that the rest of the filter calls certain."""
    log, chosen = heard(truth), WiClosureFilter()
    links = chosen.gather(odometry, log).by_pair
    certain = {pair: replace(one, ambiguous=False) for pair, one in chosen.align(odometry, links).items()}
    return clocks_in_doubt(certain, links, odometry, log, chosen.settings.alignment)


def recorded(truth: dict[str, FloatArray], ahead_s: float = 0.0, until: int = 91) -> dict[str, Trajectory]:
    """Odometry of both, of which b's clock is ahead, and ends earlier."""
    stamps_ns = np.round(TIMES_S * 1e9).astype(np.int64)
    later_ns = stamps_ns + round(ahead_s * 1e9)
    return {
        "a": Trajectory("a", stamps_ns, truth["a"]),
        "b": Trajectory("b", later_ns[:until], truth["b"][:until]),
    }


@pytest.mark.parametrize(("ahead_s", "outside"), [(CLOCK_S, 5), (-CLOCK_S, 4)])
def test_a_clock_that_only_the_ends_tell_is_in_doubt(ahead_s: float, outside: int) -> None:
    (reason,) = in_doubt(STRAIGHT, recorded(STRAIGHT, ahead_s)).values()
    side = "ahead of" if ahead_s > 0 else "behind"
    assert f"{outside} of 23 measurements lie outside" in reason
    assert any(f"b's odometry would be {shift} s {side} the log" in reason for shift in (16, 17, 18))


def test_a_log_that_went_on_longer_leaves_robots_that_turn_certain() -> None:
    assert in_doubt(TURNING, recorded(TURNING, until=70)) == {}


def test_a_log_within_both_odometries_is_never_in_doubt() -> None:
    assert in_doubt(STRAIGHT, recorded(STRAIGHT)) == {}
