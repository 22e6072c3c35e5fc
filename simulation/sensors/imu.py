"""What an IMU on a simulated robot would record."""

from __future__ import annotations

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.settings import Settings
from wiclosure.simulation.world.motion import START_NS, Motion
from wiclosure.types import FloatArray, ImuLog

GRAVITY_MPS2 = 9.81
_SPAN_S = 0.05  # before and after a sample, over which its acceleration is measured: motions are no smoother than that
_TURN_S = 0.005


class ImuSettings(Settings):
    """An IMU of ordinary quality."""

    rate_hz: float = Field(100.0, gt=0, description="samples per second")
    bias_mps2: float = Field(0.05, ge=0, description="m/s^2, standard deviation of each axis's constant error")
    noise_mps2: float = Field(0.05, ge=0, description="m/s^2, of a sample")
    bias_rps: float = Field(0.003, ge=0, description="rad/s, standard deviation of each axis's constant error")
    noise_rps: float = Field(0.003, ge=0, description="rad/s, of a sample")
    roll_deg: float = Field(0.0, description="degrees about the LiDAR's x that the IMU is turned by")
    pitch_deg: float = Field(0.0, description="degrees, then about its y")
    yaw_deg: float = Field(0.0, description="degrees, then about its z")
    x_m: float = Field(0.0, description="m, its place in the LiDAR's frame")
    y_m: float = Field(0.0, description="m")
    z_m: float = Field(-0.1, description="m")

    def T_lidar_imu(self) -> FloatArray:
        """Mounting `(4, 4)`."""
        R = Rotation.from_euler("xyz", [self.roll_deg, self.pitch_deg, self.yaw_deg], degrees=True).as_matrix()
        return se3.from_rotation_translation(R, np.array([self.x_m, self.y_m, self.z_m]))


def simulate_imu(motion: Motion, settings: ImuSettings, rng: np.random.Generator) -> ImuLog:
    """Specific force and turning rates along a motion; the world's z points up."""
    stamps_ns = START_NS + np.arange(0, motion.duration_ns, round(1e9 / settings.rate_hz), dtype=np.int64)
    T_lidar_imu = settings.T_lidar_imu()

    def at(offset_s: float) -> FloatArray:
        return np.asarray(motion.T_world_body(stamps_ns + round(offset_s * 1e9)) @ T_lidar_imu)

    now = at(0.0)
    before, after = at(-_SPAN_S)[:, :3, 3], at(_SPAN_S)[:, :3, 3]
    acceleration = (after - 2.0 * now[:, :3, 3] + before) / _SPAN_S**2
    force = np.einsum("nji,nj->ni", now[:, :3, :3], acceleration + np.array([0.0, 0.0, GRAVITY_MPS2]))
    rate = se3.log(se3.between(at(-_TURN_S), at(_TURN_S)))[:, :3] / (2.0 * _TURN_S)
    return ImuLog(
        stamps_ns,
        force + rng.normal(0.0, settings.bias_mps2, 3) + rng.normal(0.0, settings.noise_mps2, force.shape),
        rate + rng.normal(0.0, settings.bias_rps, 3) + rng.normal(0.0, settings.noise_rps, rate.shape),
    )
