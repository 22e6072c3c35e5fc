"""Up along a path: tilt, bias, and how sure both are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wiclosure.frontends.inertial.gravity import fit_gravity, level_rotation, up_at_keyframes
from wiclosure.frontends.inertial.windows import windows_along
from wiclosure.simulation.sensors.imu import ImuSettings, simulate_imu


def tilt_rms_deg(up, keyframes_world):
    return np.degrees(np.sqrt(np.mean(up.angles_off(keyframes_world[:, :3, :3]) ** 2)))


def test_up_is_found_to_a_third_of_a_degree_on_hills_with_a_biased_sensor(imu, odometry, keyframes, truth):
    fit = fit_gravity(windows_along(imu, odometry), odometry, np.eye(3), np.array([0.0, 0.0, -0.1]))
    up = up_at_keyframes(fit, keyframes)
    assert fit.good.all()
    assert abs(fit.length - 9.81) < 0.1
    assert tilt_rms_deg(up, truth.poses[::8]) < 0.35
    assert tilt_rms_deg(up, truth.poses[::8]) < 2 * np.degrees(np.median(up.sigma_rad)) < 2.0


def test_the_frame_is_set_upright(imu, odometry, truth):
    fit = fit_gravity(windows_along(imu, odometry), odometry, np.eye(3))
    R_world_odom = truth.poses[0, :3, :3]
    up_world = R_world_odom @ fit.R_level_odom.T @ [0, 0, 1]
    assert np.degrees(np.arccos(up_world[2])) < 0.3


def test_the_bias_is_found_where_the_robot_turns(motion, odometry):
    rng = np.random.default_rng(5)
    clean = simulate_imu(motion, ImuSettings(bias_mps2=0.0), rng)
    bias = np.array([0.12, -0.09, 0.05])
    imu = type(clean)(clean.stamps_ns, clean.acceleration + bias, clean.turning_rate)
    fit = fit_gravity(windows_along(imu, odometry), odometry, np.eye(3))
    off = fit.bias - bias
    assert np.abs(off[:2]).max() < 0.03
    assert (np.abs(off) < 4 * np.sqrt(np.diag(fit.bias_covariance)) + 0.01).all()


def test_gravity_of_another_length_is_left_out(imu, odometry):
    windows = windows_along(imu, odometry)
    windows.force[3:5] *= 1.1
    fit = fit_gravity(windows, odometry, np.eye(3))
    assert np.flatnonzero(~fit.good).tolist() == [3, 4]


@pytest.mark.parametrize("seconds", [3, 30])
def test_a_robot_that_stands_still_has_one_direction_with_the_bias_in_its_sigma(seconds):
    from wiclosure import se3
    from wiclosure.types import ImuLog, Trajectory

    stamps_ns = np.arange(0, (12 + seconds) * 10**9, 10**8, dtype=np.int64)
    R = Rotation.from_euler("xy", [10, -5], degrees=True).as_matrix()
    poses = np.tile(se3.from_rotation_translation(R, np.zeros(3)), (len(stamps_ns), 1, 1))
    odometry = Trajectory("a", stamps_ns, poses)
    rng = np.random.default_rng(0)
    felt = R.T @ [0, 0, 9.81] + rng.normal(0, 0.02, (len(stamps_ns), 3))
    imu = ImuLog(stamps_ns, felt, np.zeros_like(felt))
    fit = fit_gravity(windows_along(imu, odometry), odometry, np.eye(3))
    up = up_at_keyframes(fit, odometry.keyframes(np.array([0])))
    assert up.index.tolist() == [0]
    assert np.degrees(up.angles_off(poses[:, :3, :3]))[0] < 0.3
    assert np.degrees(up.sigma_rad)[0] == pytest.approx(0.29, abs=0.03)  # 0.05 m/s^2, however long it stood


@given(st.integers(0, 10_000))
def test_levelling_turns_up_to_z_by_the_smallest_turn(seed):
    up = np.random.default_rng(seed).normal(size=3)
    R = level_rotation(up)
    np.testing.assert_allclose(R @ up, [0, 0, np.linalg.norm(up)], atol=1e-9)
    angle = np.arccos(up[2] / np.linalg.norm(up))
    assert Rotation.from_matrix(R).magnitude() == pytest.approx(angle, abs=1e-6)


def test_levelling_of_up_and_down():
    np.testing.assert_array_equal(level_rotation(np.array([0, 0, 2.0])), np.eye(3))
    np.testing.assert_allclose(level_rotation(np.array([0, 0, -2.0])) @ [0, 0, -1], [0, 0, 1])


def test_what_the_model_does_not_have_widens_what_it_says_of_itself(imu, odometry, keyframes, truth):
    unlike = type(imu)(imu.stamps_ns, imu.acceleration * [1.0, 1.3, 1.0], imu.turning_rate)
    sound, spoilt = (fit_gravity(windows_along(log, odometry), odometry, np.eye(3)) for log in (imu, unlike))
    assert spoilt.excess > 1.2
    assert sound.excess == 1.0
    up = up_at_keyframes(spoilt, keyframes)
    assert np.sqrt(np.mean((up.angles_off(truth.poses[::8, :3, :3]) / up.sigma_rad) ** 2)) < 2.0
