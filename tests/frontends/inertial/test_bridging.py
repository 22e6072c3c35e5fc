"""Stretches on which odometry slips and its IMU tells: it is mended there, and left alone elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.frontends.inertial.bridging import bridged
from wiclosure.frontends.inertial.estimate import estimate_up
from wiclosure.types import Trajectory


def composed(of, steps):
    poses = [of.poses[0]]
    for step in steps:
        poses.append(poses[-1] @ step)
    return Trajectory(of.robot, of.stamps_ns, np.stack(poses))


def noisy(odometry, seed, sigma_rad=0.001, sigma_m=0.015):
    """As scan matching against a map is: off a little at every scan, and by little more after many."""
    rng = np.random.default_rng(seed)
    error = rng.normal(size=(len(odometry), 6)) * np.repeat([sigma_rad, sigma_m], 3)
    return replace(odometry, poses=odometry.poses @ se3.exp(error))


def slipped(odometry, begin, end, share, turn_rad):
    """Steps `begin` to `end` fall short by a share, and turn by so much altogether."""
    steps = se3.between(odometry.poses[:-1], odometry.poses[1:])
    steps[begin:end, :3, 3] *= 1.0 - share
    steps[begin:end] = steps[begin:end] @ se3.from_yaw(np.full(end - begin, turn_rad / (end - begin)), np.zeros(3))
    return composed(odometry, steps)


def fit_of(odometry, imu, T=None):
    found = estimate_up(
        imu, odometry, odometry.keyframes(np.arange(0, len(odometry), 8)), np.eye(4) if T is None else T
    )
    assert found.fit is not None
    return found.fit


def distance_at_the_end(odometry, truth):
    ours, true = (se3.between(path.poses[0], path.poses[-1]) for path in (odometry, truth))
    return float(np.linalg.norm(ours[:3, 3] - true[:3, 3]))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("share", "turn_deg"), [(0.6, 0.0), (0.0, 4.0), (0.5, -3.0)])
def test_a_slip_of_seconds_is_mended(imu, odometry, seed, share, turn_deg):
    begin = 150 + 100 * seed
    off = slipped(noisy(odometry, seed), begin, begin + 30, share, np.radians(turn_deg))
    before, found = distance_at_the_end(off, odometry), bridged(off, imu, fit_of(off, imu), np.eye(3), np.zeros(3))
    assert before > 1.0
    assert found.steps[begin : begin + 30].all()
    assert not found.steps[: begin - 130].any()
    assert not found.steps[begin + 160 :].any()
    assert distance_at_the_end(found.odometry, odometry) < max(0.4 * before, 0.5)
    assert f"{found.moved_m[0]:.1f} m and {np.degrees(found.turned_rad[0]):.1f} degrees" in found.sentence()


@pytest.mark.parametrize("seed", range(4))
def test_an_odometry_that_holds_is_left_alone(imu, odometry, seed):
    path = noisy(odometry, seed)
    found = bridged(path, imu, fit_of(path, imu), np.eye(3), np.zeros(3))
    assert not found.steps.any()
    assert found.odometry is path
    assert found.sentence() == ""


def test_so_is_one_without_noise_whose_imu_stands_aside(turned_imu, odometry):
    T, imu = turned_imu
    assert not bridged(odometry, imu, fit_of(odometry, imu, T), T[:3, :3], T[:3, 3]).steps.any()
    assert not bridged(odometry, imu, fit_of(odometry, imu, T), T[:3, :3]).steps.any()


def test_steps_in_a_gap_of_the_imu_stay(imu, odometry):
    off = slipped(noisy(odometry, 0), 200, 230, 0.6, 0.0)
    t = (imu.stamps_ns - odometry.stamps_ns[0]) * 1e-9
    silent = imu.subset((t < 21.0) | (t > 22.0))
    found = bridged(off, silent, fit_of(off, silent), np.eye(3), np.zeros(3))
    assert not found.steps[209:221].any()


def test_an_imu_that_disagrees_throughout_is_not_followed(imu, odometry):
    steps = se3.between(odometry.poses[:-1], odometry.poses[1:])
    rng = np.random.default_rng(0)
    wild = np.where(np.arange(len(steps)) % 200 < 130, 1.0, 0.0)[:, None] * rng.normal(0.0, 0.4, (len(steps), 3))
    steps[:, :3, 3] += wild
    off = composed(odometry, steps)
    assert not bridged(off, imu, fit_of(odometry, imu), np.eye(3), np.zeros(3)).steps.any()
