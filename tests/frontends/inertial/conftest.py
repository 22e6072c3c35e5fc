"""A robot that drives curves over hills, with odometry as good as the truth, and its IMU."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.simulation.sensors.imu import ImuSettings, simulate_imu
from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.motion import START_NS, MotionSettings, drive
from wiclosure.types import Trajectory


@pytest.fixture(scope="session")
def motion():
    way = np.array([[0, 0], [30, 0], [40, 20], [20, 40], [0, 30], [-20, 45], [-30, 10], [0, -10], [30, -20], [60, 0.0]])
    return drive(
        way,
        rough_ground(np.random.default_rng(3), (-60.0, -60.0), (90.0, 80.0), 0.6),
        MotionSettings(speed_mps=3.0, sensor_height_m=0.8),
    )


@pytest.fixture(scope="session")
def truth(motion):
    """`T_world_body` at 10 Hz; the world's z points up."""
    stamps_ns = START_NS + np.arange(0, motion.duration_ns, 100_000_000, dtype=np.int64)
    return Trajectory("alpha", stamps_ns, motion.T_world_body(stamps_ns))


@pytest.fixture(scope="session")
def odometry(truth):
    """The same from where it starts, so that its frame leans as the robot did then."""
    return truth.moved(se3.inverse(truth.poses[0]))


@pytest.fixture(scope="session")
def keyframes(odometry):
    return odometry.keyframes(np.arange(0, len(odometry), 8))


@pytest.fixture(scope="session")
def imu(motion):
    """Samples in the LiDAR's axes."""
    return simulate_imu(motion, ImuSettings(), np.random.default_rng(0))


@pytest.fixture(scope="session")
def turned_imu(motion):
    """Mounting, and samples of an IMU that is turned and stands aside."""
    settings = ImuSettings(roll_deg=20.0, pitch_deg=-35.0, yaw_deg=110.0, x_m=0.4, y_m=-0.2)
    return settings.T_lidar_imu(), simulate_imu(motion, settings, np.random.default_rng(1))
