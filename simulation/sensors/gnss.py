"""What a satellite receiver on a simulated robot would give."""

from __future__ import annotations

import numpy as np
from pydantic import Field
from scipy.signal import lfilter

from wiclosure.geodesy import geodetic_at
from wiclosure.settings import Settings
from wiclosure.simulation.world.motion import START_NS, Motion
from wiclosure.types import FloatArray, GnssLog


class GnssSettings(Settings):
    """A receiver without corrections."""

    rate_hz: float = Field(1.0, gt=0, description="fixes per second")
    sigma_m: float = Field(1.5, gt=0, description="m, each horizontal axis; heights err twice as much")
    correlation_s: float = Field(60.0, gt=0, description="s, over which its error wanders")
    noise_m: float = Field(0.1, ge=0, description="m, of each fix on top of that")
    outages: int = Field(1, ge=0, description="times without fixes, spread over the drive")
    outage_s: float = Field(30.0, ge=0, description="s, how long each lasts")
    gross: float = Field(0.02, ge=0, lt=1, description="share of fixes off by tens of metres, from reflections")
    x_m: float = Field(0.0, description="m, the antenna in the LiDAR's frame")
    y_m: float = Field(0.0, description="m")
    z_m: float = Field(0.3, description="m")
    latitude: float = Field(49.0112, description="degrees, of the scene's origin; its x points east")
    longitude: float = Field(8.4229, description="degrees")
    height_m: float = Field(115.0, description="m over the ellipsoid")

    def antenna_lidar(self) -> FloatArray:
        """Its place `(3,)` in the LiDAR's frame, m."""
        return np.array([self.x_m, self.y_m, self.z_m])


def simulate_gnss(motion: Motion, settings: GnssSettings, rng: np.random.Generator) -> GnssLog:
    """Positions of the antenna along a motion, with errors that wander, outages and gross ones."""
    stamps_ns = START_NS + np.arange(0, motion.duration_ns, round(1e9 / settings.rate_hz), dtype=np.int64)
    stamps_ns = stamps_ns[~_in_outage(stamps_ns, motion.duration_ns, settings)]
    T = motion.T_world_body(stamps_ns)
    true = T[:, :3, :3] @ settings.antenna_lidar() + T[:, :3, 3]
    sigma = settings.sigma_m * np.array([1.0, 1.0, 2.0])
    keep = np.exp(-1.0 / (settings.rate_hz * settings.correlation_s))
    drive = rng.normal(size=true.shape) * np.sqrt(1.0 - keep**2)
    drive[:1] = rng.normal(size=(1, 3))
    wander = lfilter([1.0], [1.0, -keep], drive, axis=0)
    off = sigma * wander + rng.normal(0.0, settings.noise_m, true.shape)
    reflected = rng.random(len(true)) < settings.gross
    off[reflected] += rng.normal(0.0, 30.0, (int(reflected.sum()), 3))
    origin = np.array([settings.latitude, settings.longitude, settings.height_m])
    return GnssLog(stamps_ns, geodetic_at(true + off, origin), np.tile(sigma, (len(true), 1)))


def _in_outage(stamps_ns: np.ndarray, duration_ns: int, settings: GnssSettings) -> np.ndarray:
    middles_ns = START_NS + duration_ns * (np.arange(settings.outages) + 1) // (settings.outages + 1)
    apart_s = np.abs(stamps_ns[:, None] - middles_ns[None]) * 1e-9
    return np.asarray((apart_s < settings.outage_s / 2).any(axis=1))
