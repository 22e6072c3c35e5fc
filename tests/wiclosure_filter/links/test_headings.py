"""Compass readings as the yaw of the odometry frame."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import Heading, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.links.headings import OdometryHeading, odometry_headings

SECOND_NS = 10**9


def test_readings_within_the_tolerance_are_averaged() -> None:
    heading = OdometryHeading(np.array([0, 1, 2, 50]) * SECOND_NS, np.array([0.1, 0.2, 0.3, 9.0]), np.full(4, 0.05))
    yaw, sigma = heading.at(np.array([1, 30, 50]) * SECOND_NS, tolerance_s=1.0)
    np.testing.assert_allclose(yaw, [0.2, np.nan, se3.wrap_angle(np.array(9.0))], atol=1e-12)
    np.testing.assert_allclose(sigma, [0.05, np.nan, 0.05])  # one compass, wrong the same way each time


def test_surer_readings_weigh_more_and_angles_wrap() -> None:
    heading = OdometryHeading(np.array([0, 1]) * SECOND_NS, np.array([np.pi - 0.1, -np.pi + 0.1]), np.array([0.1, 0.1]))
    yaw, _ = heading.at(np.array([0]), 5.0)
    assert abs(abs(yaw[0]) - np.pi) < 1e-9
    uneven = OdometryHeading(np.array([0, 1]) * SECOND_NS, np.array([0.0, 0.01]), np.array([0.1, 0.2]))
    yaw, sigma = uneven.at(np.array([0]), 5.0)
    assert yaw[0] == pytest.approx(0.01 / 5, rel=1e-3)  # weights 100 and 25
    assert sigma[0] == pytest.approx(np.sqrt(2 / 125))


def test_the_odometrys_own_yaw_is_taken_off() -> None:
    stamps_ns = np.arange(10, dtype=np.int64) * SECOND_NS
    yaw = np.linspace(0, 2, 10)
    team = {
        "a": Trajectory("a", stamps_ns, se3.from_yaw(yaw, np.zeros((10, 3)))),
        "b": Trajectory("b", stamps_ns, se3.from_yaw(yaw, np.zeros((10, 3)))),
    }
    inside = tuple(Heading(int(stamps_ns[k]), "a", float(yaw[k]) + 0.7, 0.05) for k in (7, 2, 5))
    log = WirelessLog(
        headings=(*inside, Heading(99 * SECOND_NS, "a", 0.0, 0.05), Heading(99 * SECOND_NS, "b", 0.0, 0.05))
    )
    found = odometry_headings(team, log)
    assert set(found) == {"a"}  # what b reads lies outside its trajectory
    np.testing.assert_allclose(found["a"].yaw_world_odom, 0.7)
    assert found["a"].stamps_ns.tolist() == [2 * SECOND_NS, 5 * SECOND_NS, 7 * SECOND_NS]
