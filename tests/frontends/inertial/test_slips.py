"""Slips of an odometry: found where inertia forbids a step, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.frontends.inertial.slips import Slips, find_slips, lost_steps, opened, turned_otherwise
from wiclosure.frontends.inertial.turning import TurningRates
from wiclosure.types import ImuLog, Trajectory


def drive(seed=0, count=400, noise_m=0.02, rate_hz=10):
    """Bends at changing speed, with a standstill, and odometry noise."""
    rng, t = np.random.default_rng(seed), np.arange(count) / rate_hz
    speed = np.clip(8 * np.sin(t / 5), 0.0, None)
    yaw = np.cumsum(0.3 * np.sin(t / 3) * (speed > 0)) / rate_hz
    positions = np.cumsum(speed[:, None] * np.column_stack([np.cos(yaw), np.sin(yaw), 0 * t]), axis=0) / rate_hz
    poses = se3.from_yaw(yaw, positions + rng.normal(0, noise_m, positions.shape))
    return Trajectory("a", np.rint(t * 1e9).astype(np.int64), poses)


def slipped(odometry, at, xi):
    """Everything from pose `at` on moved in the axes of the pose before."""
    poses = odometry.poses.copy()
    before = poses[at - 1]
    poses[at:] = before @ se3.exp(np.asarray(xi, float)[None])[0] @ se3.inverse(before) @ poses[at:]
    return Trajectory(odometry.robot, odometry.stamps_ns, poses, odometry.drift)


@pytest.mark.parametrize("seed", range(5))
def test_an_odometry_that_holds_has_none(seed):
    assert len(find_slips(drive(seed))) == 0


@pytest.mark.parametrize("seed", range(3))
def test_a_leap_is_found_with_its_time_and_size(seed):
    odometry = slipped(drive(seed), 120, [0, 0, np.radians(40), 2.0, -1.0, 0.0])
    slips = find_slips(odometry)
    assert slips.index[0] == 120
    assert slips.gross[0]
    assert 1.8 < slips.departure_m[0] < 3.0
    assert np.degrees(slips.departure_rad[0]) == pytest.approx(40, abs=3)
    assert "slips 2 times, at 12.0" in slips.sentence(0)
    assert "s after its start, most at 12." in slips.sentence(0)
    assert "slips once, at 12.0 s after its start, by" in lost_steps(odometry, np.array([120])).sentence(0)
    assert not Slips.none().sentence(0)


def test_only_from_the_slip_on_steps_are_in_doubt_by_their_own_departure():
    plain = drive()
    odometry = slipped(plain, 120, [0, 0, 0, 3.0, 0, 0])
    wide = opened(odometry, find_slips(odometry))
    i = np.arange(len(plain) - 1)
    sigma = np.sqrt(wide.relative_covariance(i, i + 1)[:, 3, 3])
    usual = np.sqrt(plain.relative_covariance(i, i + 1)[:, 3, 3])
    np.testing.assert_allclose(sigma[:119], usual[:119], atol=2e-3)
    assert sigma[119] > 2.5
    assert sigma[125:].max() < 0.3


def test_recorded_odometry_of_kitti_does_not_slip(data_dir):
    for sequence in ("00", "05", "08"):
        path = data_dir / "kitti_odometry" / "kiss_icp" / f"{sequence}.txt"
        rows = np.loadtxt(path).reshape(-1, 3, 4)
        U, _, Vt = np.linalg.svd(rows[:, :, :3])
        poses = se3.from_rotation_translation(U @ Vt, rows[:, :, 3])
        assert len(find_slips(Trajectory("a", np.arange(len(poses), dtype=np.int64) * 10**8, poses))) == 0


def test_a_gyroscope_tells_turns_that_were_none():
    plain = drive(noise_m=0.0)
    t = np.arange(0, 40, 0.01)
    stamps_ns = np.rint(t * 1e9).astype(np.int64)
    rate = se3.log(se3.between(plain.at(stamps_ns), plain.at(stamps_ns + 10**7)))[:, :3] / 0.01
    rate += np.random.default_rng(0).normal(0, 0.002, rate.shape)
    imu = ImuLog(stamps_ns, np.zeros_like(rate), np.array([0.001, 0.0, 0.002]) + rate)
    rates = TurningRates.of(imu, plain)
    assert len(turned_otherwise(plain, rates, np.eye(3))) == 0
    odometry = slipped(plain, 200, [0, 0, np.radians(8), 0, 0, 0])
    slips = turned_otherwise(odometry, TurningRates.of(imu, odometry), np.eye(3))
    assert slips.index.tolist() == [200]
    assert np.degrees(slips.departure_rad[0]) == pytest.approx(8, abs=0.5)


def test_both_kinds_count_once():
    odometry = slipped(drive(), 50, [0, 0, 0, 3.0, 0, 0])
    slips = find_slips(odometry)
    again = slips + Slips(np.array([20, 50]), odometry.stamps_ns[[20, 50]], np.ones(2), np.ones(2), np.ones(2, bool))
    assert len(again) == len(slips) + 1
    assert again.index[0] == 20
    assert (np.diff(again.index) > 0).all()


def test_a_few_poses_tell_nothing():
    assert len(find_slips(drive(count=3))) == 0
