"""LiDAR models: beam tables, noise, and one sweep of rays from a moving sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wiclosure.errors import ConfigError
from wiclosure.simulation.names import lookup
from wiclosure.simulation.world.scene import Scene, cast_at
from wiclosure.simulation.world.traffic import Traffic
from wiclosure.types import BoolArray, Float32Array, FloatArray, IntArray, Scan

_GREATEST_ELEVATION_ERROR_DEG = 5.0


@dataclass(frozen=True, eq=False)
class LidarModel:
    """A spinning LiDAR: all beams of a column fire at once, columns follow each other around the z axis.

    Args:
        name: for messages.
        elevations_deg: of the beams, up from the horizontal plane.
        columns: firings a turn.
        rate_hz: turns per second.
        min_range_m: nearer returns are not reported.
        max_range_m: farther returns are not reported: the range to which the sensor is cut.
        reach_m: how far it sees a surface face on.
        range_sigma_m: standard deviation of a range.
        dropout: share of returns lost, anywhere.
        least_cosine: at full reach, returns at a flatter incidence (cosine of the angle to the normal) are too weak;
            the limit falls with the square of the distance, as the echo's energy does.
        beam_sigma_deg: each beam leaves a little beside its elevation in the table, the same all the time: no
            calibration is perfect, and most of a good odometry's drift comes from that.
        beam_sigma_m: each beam's constant range error.
        elevation_error_deg: by how much more than the table all beams look up.

    Raises:
        ConfigError: an impossible value.
    """

    name: str
    elevations_deg: tuple[float, ...]
    columns: int
    rate_hz: float = 10.0
    min_range_m: float = 0.5
    max_range_m: float = 100.0
    reach_m: float = 100.0
    range_sigma_m: float = 0.02
    dropout: float = 0.02
    least_cosine: float = 0.15
    beam_sigma_deg: float = 0.03
    beam_sigma_m: float = 0.01
    elevation_error_deg: float = 0.0

    def __post_init__(self) -> None:
        for sigma in (self.range_sigma_m, self.beam_sigma_deg, self.beam_sigma_m):
            if not sigma >= 0:
                raise ConfigError(f"lidar {self.name}: a noise is {sigma}; it must be >= 0")
        if not 0 <= self.dropout < 1:
            raise ConfigError(f"lidar drop-out is {self.dropout}; it must be a share >= 0 and < 1")
        if not 0 <= self.min_range_m < self.max_range_m:
            raise ConfigError(
                f"lidar range is cut to {self.min_range_m}..{self.max_range_m} m; the end must lie beyond the start"
            )
        if not abs(self.elevation_error_deg) <= _GREATEST_ELEVATION_ERROR_DEG:
            raise ConfigError(
                f"lidar {self.name}: all beams look {self.elevation_error_deg} degrees higher than they say; at most"
                f" {_GREATEST_ELEVATION_ERROR_DEG:g} either way are an error"
            )
        if not self.rate_hz > 0:
            raise ConfigError(f"lidar rate is {self.rate_hz} Hz; it must be > 0")

    @property
    def period_ns(self) -> int:
        """Time of one turn."""
        return round(1e9 / self.rate_hz)

    @cached_property
    def directions(self) -> Float32Array:
        """`(columns, beams, 3)` unit vectors in the sensor's axes; a turn starts behind and runs clockwise."""
        return self._directions(np.zeros(len(self.elevations_deg)))

    def individual(self, rng: np.random.Generator) -> Individual:
        """One sensor of this model, with calibration errors of its own."""
        beams = len(self.elevations_deg)
        elevation_deg, range_m = rng.standard_normal(beams), rng.standard_normal(beams)
        return Individual(
            self,
            self._directions(self.elevation_error_deg + self.beam_sigma_deg * elevation_deg),
            (self.beam_sigma_m * range_m).astype(np.float32),
        )

    def _directions(self, error_deg: FloatArray) -> Float32Array:
        azimuth = np.pi - 2 * np.pi * (np.arange(self.columns) + 0.5) / self.columns
        elevation = np.deg2rad(np.array(self.elevations_deg) + error_deg)
        out = np.empty((self.columns, len(elevation), 3), np.float32)
        out[..., 0] = np.cos(azimuth)[:, None] * np.cos(elevation)
        out[..., 1] = np.sin(azimuth)[:, None] * np.cos(elevation)
        out[..., 2] = np.sin(elevation)
        return out

    @cached_property
    def column_offsets_ns(self) -> IntArray:
        """`(columns,)` time after the start of the turn at which each column fires."""
        return np.round(np.arange(self.columns) * (self.period_ns / self.columns)).astype(np.int64)

    @cached_property
    def ray_times_s(self) -> FloatArray:
        """`(columns * beams,)` seconds after the start of the turn at which each ray leaves."""
        return np.repeat(self.column_offsets_ns / 1e9, len(self.elevations_deg))


@dataclass(frozen=True, eq=False)
class Individual:
    """One LiDAR with its calibration errors.

    Args:
        model: what it reports to be.
        true_directions: `(columns, beams, 3)` where its rays really go.
        range_error_m: `(beams,)` added to every range.
    """

    model: LidarModel
    true_directions: Float32Array
    range_error_m: Float32Array


_POSES_PER_TURN = 41

PoseAt = Callable[[IntArray], FloatArray]
"""`T_world_sensor (N, 4, 4)` at stamps `(N,)`, nanoseconds."""


def sweep(
    lidar: Individual,
    scene: Scene,
    pose_at: PoseAt,
    stamp_ns: int,
    rng: np.random.Generator,
    traffic: Traffic | None = None,
) -> tuple[Scan, BoolArray]:
    """One turn that starts at `stamp_ns`, every column fired from where the sensor is at that time.

    Returns:
        The scan, and `(N,)` which of its points are of what moves.
    """
    model, beams = lidar.model, len(lidar.range_error_m)
    T_world_sensor = _column_poses(model, pose_at, stamp_ns)
    rays = np.empty((model.columns, beams, 6), np.float32)
    rays[..., :3] = T_world_sensor[:, None, :, 3]
    np.matmul(lidar.true_directions, np.swapaxes(T_world_sensor[:, :, :3], 1, 2), out=rays[..., 3:])
    true_m, cosine = scene.cast(rays.reshape(-1, 6))
    moving = np.zeros(len(true_m), bool)
    if traffic is not None:
        there = traffic.seen(pose_at(np.array([stamp_ns]))[0], stamp_ns, model.period_ns, model.max_range_m)
        passing = cast_at(there, rays.reshape(-1, 6))
        moving = passing.distance_m < true_m
        true_m, cosine = np.where(moving, passing.distance_m, true_m), np.where(moving, passing.cosine, cosine)
    range_m = rng.standard_normal(len(true_m), dtype=np.float32)
    range_m *= np.float32(model.range_sigma_m)
    range_m += true_m
    range_m += np.tile(lidar.range_error_m, model.columns)
    seen = np.flatnonzero(
        (range_m >= model.min_range_m)
        & (range_m <= model.max_range_m)
        & (cosine >= model.least_cosine * (true_m / model.reach_m) ** 2)
        & (rng.random(len(true_m), dtype=np.float32) >= model.dropout)
    )
    points = np.take(model.directions.reshape(-1, 3), seen, axis=0)
    points *= np.take(range_m, seen)[:, None]
    scan = Scan(stamp_ns, points.astype(np.float64), np.take(model.ray_times_s, seen), np.take(cosine, seen))
    return scan, moving[seen]


def _column_poses(model: LidarModel, pose_at: PoseAt, stamp_ns: int) -> Float32Array:
    """`T_world_sensor (columns, 3, 4)`, straight between a few poses of the turn.

    In a fortieth of a turn (2.5 ms at 10 Hz) the straight line errs by less than float32 resolves (1 rad/s: 1e-6).
    """
    offsets_ns = model.column_offsets_ns
    knots_ns = np.linspace(0, offsets_ns[-1], _POSES_PER_TURN).astype(np.int64)
    poses = pose_at(stamp_ns + knots_ns)[:, :3].reshape(_POSES_PER_TURN, 12)
    after = np.clip(np.searchsorted(knots_ns, offsets_ns), 1, _POSES_PER_TURN - 1)
    share = ((offsets_ns - knots_ns[after - 1]) / (knots_ns[after] - knots_ns[after - 1]))[:, None]
    columns = poses[after - 1] + share * (poses[after] - poses[after - 1])
    return columns.astype(np.float32).reshape(-1, 3, 4)


def _even(low_deg: float, high_deg: float, beams: int) -> tuple[float, ...]:
    return tuple(np.linspace(low_deg, high_deg, beams).tolist())


_VLP32_DEG = (
    *(-25.0, -15.639, -11.31, -8.843, -7.254, -6.148, -5.333, -4.667, -4.0, -3.667, -3.333),
    *(-3.0, -2.667, -2.333, -2.0, -1.667, -1.333, -1.0, -0.667, -0.333, 0.0, 0.333, 0.667),
    *(1.0, 1.333, 1.667, 2.333, 3.333, 4.667, 7.0, 10.333, 15.0),
)

LIDARS: dict[str, LidarModel] = {
    # Manufacturers' data sheets. HDL-64E: an upper block at 1/3 degree, a lower one at 1/2 degree.
    "hdl64": LidarModel(
        "hdl64",
        _even(-24.33, -8.83, 32) + _even(-8.33, 2.0, 32),
        1800,
        max_range_m=120.0,
        reach_m=120.0,
        beam_sigma_deg=0.1,
        beam_sigma_m=0.02,
        # What those who publish odometry on KITTI's recordings add to all elevations, KISS-ICP's authors among them.
        elevation_error_deg=0.205,
    ),
    "vlp16": LidarModel("vlp16", _even(-15.0, 15.0, 16), 1800),
    "vlp32": LidarModel("vlp32", _VLP32_DEG, 1800, max_range_m=200.0, reach_m=200.0),
    "os1-64": LidarModel("os1-64", _even(-22.5, 22.5, 64), 1024, max_range_m=90.0, reach_m=90.0),
    "generic-32": LidarModel("generic-32", _even(-25.0, 15.0, 32), 900, max_range_m=80.0, reach_m=80.0),
}


def lidar_model(name: str) -> LidarModel:
    """The LiDAR of that name; `ConfigError` with a suggestion when there is none."""
    return lookup("lidar", name, LIDARS)
