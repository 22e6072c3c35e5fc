"""Turning rates of odometry and gyroscope: clocks, units, and steps without samples."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.frontends.inertial.turning import TurningRates, clock_offset_s
from wiclosure.types import ImuLog


def test_both_see_the_same_turns(imu, odometry):
    rates = TurningRates.of(imu, odometry)
    assert rates.tells
    assert len(rates) > 0.95 * (len(odometry) - 1)
    assert rates.correlation > 0.95
    assert rates.scale == pytest.approx(1.0, abs=0.05)
    np.testing.assert_allclose(rates.imu, rates.odometry, atol=0.06)


@pytest.mark.parametrize("offset_s", [-1.5, -0.2, 0.0, 0.7])
def test_the_clock_is_found(imu, odometry, offset_s):
    late = ImuLog(imu.stamps_ns - round(offset_s * 1e9), imu.acceleration, imu.turning_rate)
    found, correlation = clock_offset_s(late, odometry)
    assert found == pytest.approx(offset_s, abs=0.03)
    assert correlation > 0.95


def test_steps_in_a_gap_are_left_out(imu, odometry):
    seconds = (imu.stamps_ns - odometry.stamps_ns[0]) * 1e-9
    rates = TurningRates.of(imu.subset((seconds < 5.0) | (seconds > 9.0)), odometry)
    whole = TurningRates.of(imu, odometry)
    assert len(whole) - 45 <= len(rates) <= len(whole) - 40
    np.testing.assert_allclose(rates.imu, rates.odometry, atol=0.06)


def test_a_short_log_tells_no_clock(imu, odometry):
    assert clock_offset_s(imu.subset(np.arange(100)), odometry) == (0.0, 0.0)
