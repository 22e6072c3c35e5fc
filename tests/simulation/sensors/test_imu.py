"""The simulated IMU agrees with the motion that it is on."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.simulation.sensors.imu import GRAVITY_MPS2, ImuSettings, simulate_imu
from wiclosure.simulation.world.motion import START_NS

PERFECT = {"bias_mps2": 0.0, "noise_mps2": 0.0, "bias_rps": 0.0, "noise_rps": 0.0}


class Circle:
    """At 2 m/s around a circle of 10 m, level."""

    duration_ns = 20 * 10**9

    def T_world_body(self, stamps_ns):
        angle = 0.2 * (stamps_ns - START_NS) * 1e-9
        place = 10.0 * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)
        return se3.from_yaw(angle, place)


def test_a_circle_at_even_speed():
    log = simulate_imu(Circle(), ImuSettings(z_m=0.0, **PERFECT), np.random.default_rng(0))
    assert len(log) == 2000
    np.testing.assert_allclose(log.acceleration[10:-10], np.tile([0, 0.4, GRAVITY_MPS2], (1980, 1)), atol=1e-4)
    np.testing.assert_allclose(log.turning_rate[10:-10], np.tile([0, 0, 0.2], (1980, 1)), atol=1e-6)


def test_mounting_turns_what_is_felt_and_the_lever_arm_adds_to_it():
    settings = ImuSettings(yaw_deg=90.0, x_m=1.0, z_m=0.0, **PERFECT)
    log = simulate_imu(Circle(), settings, np.random.default_rng(0))
    in_body = log.turned(settings.T_lidar_imu()[:3, :3])
    np.testing.assert_allclose(in_body.acceleration[100], [-0.04, 0.4, GRAVITY_MPS2], atol=1e-4)
    np.testing.assert_allclose(log.acceleration[100], [0.4, 0.04, GRAVITY_MPS2], atol=1e-4)


def test_errors_are_as_stated():
    settings = ImuSettings(bias_mps2=0.0, noise_mps2=0.3, bias_rps=0.0, noise_rps=0.02)
    log = simulate_imu(Circle(), settings, np.random.default_rng(0))
    assert abs(log.acceleration[10:-10].std(axis=0).mean() - 0.3) < 0.02
    biased = [simulate_imu(Circle(), ImuSettings(noise_mps2=0.0), np.random.default_rng(s)) for s in range(40)]
    assert 0.03 < np.std([log.acceleration[100, 2] for log in biased]) < 0.07
