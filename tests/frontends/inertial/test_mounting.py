"""The mounting from turning rates and gravity, and how sure it is."""

from __future__ import annotations

import lzma

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.frontends.inertial.estimate import estimate_up
from wiclosure.frontends.inertial.mounting import find_mounting
from wiclosure.frontends.inertial.turning import TurningRates
from wiclosure.frontends.inertial.windows import windows_along
from wiclosure.types import ImuLog, Trajectory


def angle_deg(R, other):
    return np.degrees(Rotation.from_matrix(R.T @ other).magnitude())


def test_a_turned_imu_on_a_car_is_found(turned_imu, odometry):
    T_lidar_imu, imu = turned_imu
    found = find_mounting(TurningRates.of(imu, odometry), windows_along(imu, odometry))
    assert found.observable
    assert angle_deg(found.R_body_imu, T_lidar_imu[:3, :3]) < 1.0
    assert angle_deg(found.R_body_imu, T_lidar_imu[:3, :3]) < 4 * np.degrees(np.linalg.norm(found.sigma_rad))


@pytest.mark.parametrize("seed", range(3))
def test_planar_turning_at_one_speed_leaves_one_axis_to_the_curves(seed):
    """Rates about one axis only: what the body's acceleration in curves adds tells the rest."""
    t, rng = np.arange(0, 60, 0.1), np.random.default_rng(seed)
    yaw = np.cumsum(0.4 * np.sin(0.3 * t)) * 0.1
    velocity = 3.0 * np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(t)])
    R = se3.from_yaw(yaw, np.zeros((len(t), 3)))[:, :3, :3]
    poses = se3.from_rotation_translation(R, np.cumsum(velocity, axis=0) * 0.1)
    stamps_ns = np.rint(t * 1e9).astype(np.int64)
    acceleration = np.gradient(velocity, 0.1, axis=0)
    felt = np.einsum("nji,nj->ni", R, np.array([0, 0, 9.81]) + acceleration) + rng.normal(0, 0.02, (len(t), 3))
    rate = np.column_stack([0 * t, 0 * t, np.gradient(yaw, 0.1)]) + rng.normal(0, 0.002, (len(t), 3))
    hidden = Rotation.random(random_state=seed).as_matrix()
    imu, odometry = ImuLog(stamps_ns, felt @ hidden, rate @ hidden), Trajectory("a", stamps_ns, poses)
    found = find_mounting(TurningRates.of(imu, odometry), windows_along(imu, odometry))
    assert angle_deg(found.R_body_imu, hidden) < 1.5


def test_turning_on_the_spot_leaves_one_axis_open_and_says_so():
    t, rng = np.arange(0, 60, 0.1), np.random.default_rng(0)
    yaw = np.cumsum(0.4 * np.sin(0.3 * t)) * 0.1
    R = se3.from_yaw(yaw, np.zeros((len(t), 3)))[:, :3, :3]
    stamps_ns = np.rint(t * 1e9).astype(np.int64)
    odometry = Trajectory("a", stamps_ns, se3.from_rotation_translation(R, np.zeros((len(t), 3))))
    felt = np.tile([0, 0, 9.81], (len(t), 1)) + rng.normal(0, 0.02, (len(t), 3))
    rate = np.column_stack([0 * t, 0 * t, np.gradient(yaw, 0.1)]) + rng.normal(0, 0.002, (len(t), 3))
    found = find_mounting(TurningRates.of(ImuLog(stamps_ns, felt, rate), odometry),
                          windows_along(ImuLog(stamps_ns, felt, rate), odometry))  # fmt: skip
    assert not found.observable
    result = estimate_up(ImuLog(stamps_ns, felt, rate), odometry, odometry.keyframes(np.arange(0, len(t), 10)))
    assert result.up is None
    assert "set imu_pose" in result.sentences[-1]


@pytest.fixture(scope="module")
def recorded(data_dir):
    folder = data_dir / "imu_continuous"
    if not folder.is_dir():
        pytest.skip(f"{folder} not found; set WICLOSURE_DATA")
    with lzma.open(folder / "imu.txt.xz", "rt") as file:
        samples = np.loadtxt(file)
    rows = np.loadtxt(folder / "traj.txt")
    poses = se3.from_rotation_translation(Rotation.from_quat(rows[:, 4:8]).as_matrix(), rows[:, 1:4])
    imu_ns, odometry_ns = (np.rint((s - rows[0, 0]) * 1e9).astype(np.int64) for s in (samples[:, 0], rows[:, 0]))
    return ImuLog(imu_ns, samples[:, 1:4], samples[:, 4:7]), Trajectory("handheld", odometry_ns, poses)


@pytest.mark.parametrize("seed", range(3))
def test_a_recording_whose_mounting_is_hidden(recorded, seed):
    imu, odometry = recorded
    hidden = Rotation.random(random_state=seed).as_matrix()
    keyframes = odometry.keyframes(np.arange(0, len(odometry), 10))
    found = estimate_up(imu.turned(hidden.T), odometry, keyframes)
    assert found.mounting is not None
    assert found.up is not None
    assert angle_deg(found.mounting.R_body_imu, hidden) < 1.0
    assert np.degrees(np.sqrt(np.mean(found.up.angles_off(keyframes.poses[:, :3, :3]) ** 2))) < 0.3
