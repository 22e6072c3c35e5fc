"""How robots move: along smooth paths, slower in turns, never faster than they can brake."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from pydantic import Field
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import ConfigError
from wiclosure.settings import Settings
from wiclosure.simulation.world.ground import Ground
from wiclosure.types import FloatArray, IntArray

START_NS = 1_000_000_000_000
"""When every simulated mission starts."""

_STEP_M = 0.05


class MotionSettings(Settings):
    """What a robot's drive can do."""

    speed_mps: float = Field(1.0, gt=0, description="m/s on a straight")
    acceleration_mps2: float = Field(0.8, gt=0, description="m/s^2, forwards and braking")
    lateral_mps2: float = Field(1.0, gt=0, description="m/s^2 sideways in turns; slows the robot there")
    turn_rate_rps: float = Field(1.0, gt=0, description="rad/s, fastest turn")
    corner_m: float = Field(1.5, gt=0, description="m before and after a waypoint over which its corner is rounded")
    sensor_height_m: float = Field(0.8, gt=0, description="m from the ground to the LiDAR")
    sway_deg: float = Field(
        0.3,
        ge=0,
        description="degrees, standard deviation of roll and pitch from unevenness under"
        " the wheels that is too small to be part of the ground's shape",
    )


class Motion(Protocol):
    """Where a robot's sensor is at any time."""

    @property
    def duration_ns(self) -> int:
        """From the mission's start to the end of the drive."""
        ...

    def T_world_body(self, stamps_ns: IntArray) -> FloatArray:
        """Sensor poses `(N, 4, 4)`, gravity-aligned world; before the start and after the end the robot stands."""
        ...


@dataclass(frozen=True, slots=True)
class Stop:
    """Standing still for `seconds` once `distance_m` along the path are travelled."""

    distance_m: float
    seconds: float


@dataclass(frozen=True, eq=False)
class GroundPath:
    """A curve on the ground, sampled densely.

    Args:
        s_m: `(K,)` arc length.
        xy_m: `(K, 2)` positions.
        yaw_rad: `(K,)` headings without jumps of 2 pi.
    """

    s_m: FloatArray
    xy_m: FloatArray
    yaw_rad: FloatArray

    @classmethod
    def through(cls, waypoints_m: FloatArray, corner_m: float) -> GroundPath:
        """A smooth curve along the polyline `waypoints_m (W, 2)` that cuts its corners.

        Raises:
            ConfigError: fewer than two waypoints, repeated ones, or a turn that no rounding makes drivable.
        """
        legs = np.linalg.norm(np.diff(waypoints_m, axis=0), axis=1)
        if len(waypoints_m) < 2 or (legs < 1e-6).any():
            raise ConfigError("a robot's path needs at least two waypoints, each apart from the next")
        at = np.concatenate([[0.0], np.cumsum(legs)])
        s = np.linspace(0.0, at[-1], max(2, round(at[-1] / _STEP_M)) + 1)
        corners = np.stack([np.interp(s, at, waypoints_m[:, axis]) for axis in (0, 1)], axis=1)
        return cls.smoothed(corners, 0.5 * corner_m)

    @classmethod
    def smoothed(cls, xy_m: FloatArray, sigma_m: float) -> GroundPath:
        """The curve through evenly spaced `xy_m (K, 2)`, smoothed along its length with a Gaussian; ends stay."""
        spacing = float(np.linalg.norm(np.diff(xy_m, axis=0), axis=1).mean())
        smooth = smoothed(xy_m, sigma_m / spacing)
        s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(smooth, axis=0), axis=1))])
        tangent = np.gradient(smooth, axis=0)
        return cls(s, smooth, np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0])))

    @property
    def length_m(self) -> float:
        """Arc length of the whole."""
        return float(self.s_m[-1])

    def curvature(self) -> FloatArray:
        """`(K,)`, rad/m."""
        return np.asarray(np.gradient(self.yaw_rad) / np.maximum(np.gradient(self.s_m), 1e-9))


@dataclass(frozen=True, eq=False)
class Sway:
    """Roll and pitch along the path: waves of the distance travelled, so a robot that stands does not sway.

    Args:
        sigma_rad: standard deviation of each angle.
        wavelengths_m: `(W,)`.
        phases_rad: `(2, W)` for roll and pitch.
    """

    sigma_rad: float
    wavelengths_m: FloatArray
    phases_rad: FloatArray

    @classmethod
    def of(cls, sigma_deg: float, speed_mps: float, seed: int) -> Sway:
        """Sway of 0.7 to 4 Hz at full speed: what springs and tyres let through."""
        rng = np.random.default_rng(seed)
        wavelengths_m = speed_mps / np.geomspace(0.7, 4.0, 9) * rng.uniform(0.9, 1.1, 9)
        return cls(float(np.deg2rad(sigma_deg)), wavelengths_m, rng.uniform(0, 2 * np.pi, (2, 9)))

    def rotations(self, distance_m: FloatArray) -> FloatArray:
        """`R_level_body (N, 3, 3)` at the distances travelled `(N,)`."""
        waves = np.sin(2 * np.pi * distance_m[:, None, None] / self.wavelengths_m + self.phases_rad)
        roll_pitch = self.sigma_rad * np.sqrt(2 / len(self.wavelengths_m)) * waves.sum(axis=2)
        return np.asarray(Rotation.from_rotvec(np.pad(roll_pitch, ((0, 0), (0, 1)))).as_matrix())


@dataclass(frozen=True, eq=False)
class PathMotion:
    """Motion along a path with piecewise constant acceleration.

    Args:
        path: the curve on the ground.
        ground: gives height and tilt.
        sensor_height_m: LiDAR above the ground.
        sway: of the body on its wheels.
        knot_s: `(K,)` seconds since the mission's start.
        knot_m: `(K,)` metres travelled at each knot.
        knot_mps: `(K,)` speed there.
    """

    path: GroundPath
    ground: Ground
    sensor_height_m: float
    sway: Sway
    knot_s: FloatArray
    knot_m: FloatArray
    knot_mps: FloatArray

    @property
    def duration_ns(self) -> int:
        """See `Motion`."""
        return int(self.knot_s[-1] * 1e9)

    def distance(self, stamps_ns: IntArray) -> FloatArray:
        """Metres travelled `(N,)`."""
        t = np.clip((stamps_ns - START_NS) * 1e-9, 0.0, self.knot_s[-1])
        i = np.clip(np.searchsorted(self.knot_s, t, side="right") - 1, 0, len(self.knot_s) - 2)
        span = self.knot_s[i + 1] - self.knot_s[i]
        acceleration = (self.knot_mps[i + 1] - self.knot_mps[i]) / span
        elapsed = t - self.knot_s[i]
        return np.asarray(self.knot_m[i] + self.knot_mps[i] * elapsed + 0.5 * acceleration * elapsed**2)

    def T_world_body(self, stamps_ns: IntArray) -> FloatArray:
        """See `Motion`."""
        s = self.distance(stamps_ns)
        path = self.path
        xy = np.stack([np.interp(s, path.s_m, path.xy_m[:, axis]) for axis in (0, 1)], axis=1)
        T_world_level = on_ground(self.ground, xy, np.interp(s, path.s_m, path.yaw_rad), self.sensor_height_m)
        T_world_level[:, :3, :3] @= self.sway.rotations(s)
        return T_world_level


def drive(
    waypoints_m: FloatArray, ground: Ground, settings: MotionSettings, stops: Sequence[Stop] = (), start_s: float = 0.0
) -> PathMotion:
    """Drives along waypoints as fast as the settings allow, from standstill to standstill.

    Args:
        waypoints_m: `(W, 2)` world x and y.
        ground: gives height and tilt.
        settings: limits of the drive.
        stops: where the robot stands still for a while.
        start_s: seconds after the mission's start at which it sets off.

    Raises:
        ConfigError: a path that cannot be driven.
    """
    path = GroundPath.through(np.asarray(waypoints_m, float), settings.corner_m)
    curvature = np.abs(path.curvature())
    sharpest = int(np.argmax(curvature))
    if curvature[sharpest] * settings.corner_m > 20:
        x, y = path.xy_m[sharpest]
        raise ConfigError(f"the path turns back on itself near ({x:.1f}, {y:.1f}); lead it around a loop instead")
    knot_s, knot_m, knot_mps = _speed_profile(path, curvature, settings, stops)
    if start_s > 0:
        knot_s = np.concatenate([[0.0], knot_s + start_s])
        knot_m, knot_mps = np.concatenate([[0.0], knot_m]), np.concatenate([[0.0], knot_mps])
    sway = Sway.of(settings.sway_deg, settings.speed_mps, seed=int(1000 * path.length_m))
    return PathMotion(path, ground, settings.sensor_height_m, sway, knot_s, knot_m, knot_mps)


def _speed_profile(
    path: GroundPath, curvature: FloatArray, settings: MotionSettings, stops: Sequence[Stop]
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Knots `(seconds, metres, m/s)` of the fastest drive within the limits."""
    s = path.s_m
    limit = np.minimum(settings.speed_mps, np.sqrt(settings.lateral_mps2 / np.maximum(curvature, 1e-9)))
    limit = np.minimum(limit, settings.turn_rate_rps / np.maximum(curvature, 1e-9)) ** 2
    halts = {int(np.searchsorted(s, stop.distance_m)): stop.seconds for stop in stops}
    if any(not 0 < index < len(s) - 1 or seconds <= 0 for index, seconds in halts.items()):
        raise ConfigError(f"a stop lies outside the path of {path.length_m:.1f} m, or lasts no time")
    if (np.diff(sorted([0, len(s) - 1, *halts])) * _STEP_M < 0.5).any():
        raise ConfigError("two stops lie less than 0.5 m apart; make them one")
    limit[[0, -1, *halts]] = 0.0
    # v^2 grows by at most 2 a per metre: forwards from every slow place, and backwards for braking.
    gain = 2 * settings.acceleration_mps2 * s
    forwards = np.minimum.accumulate(limit - gain) + gain
    backwards = np.minimum.accumulate((limit + gain)[::-1])[::-1] - gain
    v = np.sqrt(np.maximum(np.minimum(forwards, backwards), 0.0))
    t = np.concatenate([[0.0], np.cumsum(2 * np.diff(s) / (v[:-1] + v[1:]))])
    for index, seconds in halts.items():
        t[index + 1 :] += seconds
    at = np.array(sorted(halts), int)
    resume = t[at] + [halts[int(index)] for index in at]
    return (
        np.insert(t, at + 1, resume),
        np.insert(s, at + 1, s[at]),
        np.insert(v, at + 1, 0.0),
    )


def smoothed(values: FloatArray, sigma_samples: float) -> FloatArray:
    """Rows `(K, D)` smoothed with a Gaussian along the first axis; both ends go on straight, so they stay."""
    pad = int(np.ceil(4 * sigma_samples))
    head = values[0] - np.arange(pad, 0, -1)[:, None] * (values[1] - values[0])
    tail = values[-1] + np.arange(1, pad + 1)[:, None] * (values[-1] - values[-2])
    extended = np.vstack([head, values, tail])
    return np.asarray(gaussian_filter1d(extended, sigma_samples, axis=0)[pad : pad + len(values)])


def on_ground(ground: Ground, xy_m: FloatArray, yaw_rad: FloatArray, sensor_height_m: float) -> FloatArray:
    """Sensor poses `(N, 4, 4)` of a robot that stands at `xy_m (N, 2)`, upright to the ground there."""
    up = ground.normal(xy_m)
    forward = np.stack([np.cos(yaw_rad), np.sin(yaw_rad), np.zeros(len(yaw_rad))], axis=1)
    left = np.cross(up, forward)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    R = np.stack([np.cross(left, up), left, up], axis=-1)
    foot = np.column_stack([xy_m, ground.height(xy_m)])
    return se3.from_rotation_translation(R, foot + sensor_height_m * up)
