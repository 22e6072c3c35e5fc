"""Sums over windows: the robot's own motion cancels."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.frontends.inertial.windows import HOP_S, WINDOW_S, velocity_steps, windows_along
from wiclosure.types import ImuLog, Trajectory

UP = np.array([0.0, 0.0, 9.81])


def stamps(seconds):
    return np.rint(np.asarray(seconds) * 1e9).astype(np.int64) + 10**12


@given(st.integers(0, 2**32 - 1))
def test_motion_at_constant_velocity_cancels_whatever_the_stamps(seed):
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.02, 0.3, 200))
    R = Rotation.random(random_state=seed % 1000).as_matrix()
    positions = np.array([1e4, -2e4, 30.0]) + t[:, None] * rng.normal(0, 20, 3)
    odometry = Trajectory("a", stamps(t), se3.from_rotation_translation(np.tile(R, (200, 1, 1)), positions))
    t_imu = np.arange(0.0, t[-1], 0.01)
    imu = ImuLog(stamps(t_imu), np.tile(R.T @ UP, (len(t_imu), 1)), np.zeros((len(t_imu), 3)))
    windows = windows_along(imu, odometry)
    assert len(windows) >= 2
    np.testing.assert_allclose(windows.gravity(np.eye(3)), np.tile(UP, (len(windows), 1)), atol=1e-5)


def test_a_swinging_sensor_aside_of_the_body_feels_gravity_alone():
    t, t_imu = np.arange(0, 30, 0.05), np.arange(0, 30, 0.005)
    lever, rate = np.array([0.7, 0.0, 0.2]), 0.5
    R = se3.from_yaw(rate * t, np.zeros((len(t), 3)))[:, :3, :3]
    odometry = Trajectory("a", stamps(t), se3.from_rotation_translation(R, np.zeros((len(t), 3))))
    felt = UP - np.array([rate**2 * lever[0], 0.0, 0.0])  # centripetal, in the turning axes
    imu = ImuLog(stamps(t_imu), np.tile(felt, (len(t_imu), 1)), np.tile([0, 0, rate], (len(t_imu), 1)))
    windows = windows_along(imu, odometry)
    found = windows.gravity(np.eye(3)) - windows.lever @ lever
    np.testing.assert_allclose(found, np.tile(UP, (len(found), 1)), atol=2e-3)
    assert np.abs(windows.gravity(np.eye(3)) - UP).max() > 0.01  # the lever arm does matter


def test_a_bias_turns_with_the_body():
    t = np.arange(0, 20, 0.1)
    R = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    odometry = Trajectory("a", stamps(t), np.tile(se3.from_rotation_translation(R, np.zeros(3)), (len(t), 1, 1)))
    bias = np.array([0.1, 0.2, 0.3])
    imu = ImuLog(stamps(t), np.tile(R.T @ UP + bias, (len(t), 1)), np.zeros((len(t), 3)))
    windows = windows_along(imu, odometry)
    np.testing.assert_allclose(windows.gravity(np.eye(3)) - UP, windows.bias @ bias, atol=1e-9)
    np.testing.assert_allclose(windows.bias[0], R, atol=1e-12)


@pytest.mark.parametrize(("gap_imu", "gap_odometry"), [(0.5, 0.0), (0.0, 2.0), (0.5, 2.0)])
def test_no_window_spans_a_gap(gap_imu, gap_odometry):
    t, t_imu = np.arange(0, 60, 0.1), np.arange(0, 60, 0.01)
    t, t_imu = t[(t <= 20) | (t >= 20 + gap_odometry)], t_imu[(t_imu <= 40) | (t_imu >= 40 + gap_imu)]
    odometry = Trajectory("a", stamps(t), np.tile(np.eye(4), (len(t), 1, 1)))
    windows = windows_along(ImuLog(stamps(t_imu), np.zeros((len(t_imu), 3)), np.zeros((len(t_imu), 3))), odometry)
    middles = (windows.stamps_ns - 10**12) * 1e-9
    for at, gap in ((20, gap_odometry), (40, gap_imu)):
        inside = (middles + WINDOW_S / 2 > at + 1e-6) & (middles - WINDOW_S / 2 < at + gap - 1e-6)
        assert inside.any() != (gap > 0)
    whole = round((60 - WINDOW_S) / HOP_S)
    assert whole - 8 < len(windows) < whole


def test_no_window_holds_what_is_spoiled():
    t = np.arange(0, 60, 0.05)
    odometry = Trajectory("a", stamps(t), np.tile(np.eye(4), (len(t), 1, 1)))
    imu = ImuLog(stamps(t), np.tile(UP, (len(t), 1)), np.zeros((len(t), 3)))
    middles = (windows_along(imu, odometry, stamps([31.0])).stamps_ns - 10**12) * 1e-9
    assert len(middles)
    assert (np.abs(middles - 31.0) >= WINDOW_S / 2 - 1e-6).all()


def test_slopes_that_stay_have_no_steps():
    t = np.array([0.0, 0.1, 0.35, 0.4, 1.0])
    np.testing.assert_allclose(velocity_steps(np.outer(t, [1.0, -2.0]) + 5.0, t), 0.0, atol=1e-12)
    bent = np.where(t < 0.35, 0.0, t - 0.35)[:, None]
    np.testing.assert_allclose(velocity_steps(bent, t)[:, 0], [0, 0, 1, 0, 0], atol=1e-12)


def test_too_little_gives_no_window():
    odometry = Trajectory("a", stamps([0.0, 1.0, 2.0]), np.tile(np.eye(4), (3, 1, 1)))
    for count in (2, 300):
        t = 0.01 * np.arange(count)
        imu = ImuLog(stamps(t), np.zeros((count, 3)), np.zeros((count, 3)))
        assert len(windows_along(imu, odometry)) == 0
