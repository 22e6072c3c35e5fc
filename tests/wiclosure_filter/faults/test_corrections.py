"""Each correction undoes the error that it is named for, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AoaPath, Heading, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.faults.corrections import (
    azimuths_off,
    clocks_apart,
    corrections,
    ranges_off,
    sigmas_too_small,
    swapped,
)

POSES = se3.from_yaw(np.array([0.0, 0.3]), np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 0.0]]))
TEAM = {name: Trajectory(name, np.array([0, 10**9]), POSES) for name in ("a", "b")}
HEARD = WirelessMeasurement(5, "a", "b", 10.0, 0.2, (AoaPath(0.5, 0.1),))
LOG = WirelessLog((HEARD,), (Heading(5, "a", 0.1, 0.05),))


def corrected(fault: str) -> tuple[dict[str, Trajectory], WirelessMeasurement]:
    (one,) = [c for c in corrections("a", "b", LOG) if fault in c.fault]
    trajectories, log = one.apply((TEAM, LOG))
    return dict(trajectories), log.measurements[0]


@pytest.mark.parametrize(
    ("fault", "azimuth"),
    [
        ("run clockwise, not", -0.5),
        ("from the left axis, not", 0.5 + np.pi / 2),
        ("from the right axis, not", 0.5 - np.pi / 2),
        ("reversed: they", 0.5 - np.pi),
        ("clockwise from the left", -0.5 + np.pi / 2),
    ],
)
def test_azimuths(fault: str, azimuth: float) -> None:
    assert corrected(fault)[1].paths[0].azimuth == pytest.approx(azimuth)


def test_units_and_axes() -> None:
    assert corrected("in feet")[1].range_m == pytest.approx(3.048)
    assert corrected("odometry axes")[1].aoa_frame == "odometry"
    mirrored = corrected("odometry of b seems to have y to the right")[0]["b"]
    np.testing.assert_allclose(mirrored.positions[1], [1.0, -2.0, 0.0])
    assert float(se3.yaw(mirrored.poses[1])) == pytest.approx(-0.3)
    np.testing.assert_allclose(
        corrected("odometry of a seems to be about 11 % too long")[0]["a"].positions[1], [0.9, 1.8, 0]
    )


def test_offsets_names_and_sigmas() -> None:
    assert azimuths_off(0.2).apply((TEAM, LOG))[1].measurements[0].paths[0].azimuth == pytest.approx(0.3)
    assert ranges_off(3.0).apply((TEAM, LOG))[1].measurements[0].range_m == pytest.approx(7.0)
    assert clocks_apart("b", 2.0).apply((TEAM, LOG))[1].measurements[0].transmitter_stamp_ns == 2_000_000_005
    assert clocks_apart("a", 2.0).apply((TEAM, LOG))[1].measurements[0].transmitter_stamp_ns == -1_999_999_995
    log = swapped({"a": "b", "b": "a"}).apply((TEAM, LOG))[1]
    assert (log.measurements[0].receiver, log.headings[0].robot) == ("b", "b")
    wide = sigmas_too_small(10.0).apply((TEAM, LOG))[1].measurements[0]
    assert wide.range_sigma_m == pytest.approx(2.0)
    assert wide.paths[0].sigma == pytest.approx(0.35)  # wider would agree with everything


def test_nothing_is_offered_of_what_was_not_measured() -> None:
    ranges_only = WirelessLog((WirelessMeasurement(5, "a", "b", 10.0, 0.2),))
    assert not any("azimuth" in c.fault or "compass" in c.fault for c in corrections("a", "b", ranges_only))
