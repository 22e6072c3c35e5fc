"""What moves in a simulated world besides the robots: cars that come towards them, and people at the roadside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np
from pydantic import Field

from wiclosure import se3
from wiclosure.settings import Settings
from wiclosure.simulation.world.ground import Ground
from wiclosure.simulation.world.mesh import Mesh, box, car, join
from wiclosure.simulation.world.motion import START_NS, GroundPath, Motion
from wiclosure.simulation.world.scene import Scene
from wiclosure.types import BoolArray, FloatArray, IntArray

_LANE_M, _ROADSIDE_M = 2.8, -3.4  # to the left of where robots drive: the other lane, and the edge of the road
_SPACING_M = 0.5
_MARGIN_M = 0.5  # a robot's own size; movers that would run into one are not there while they would
_MIDDLE_M = 0.8  # height at which they keep clear of what stands


class TrafficSettings(Settings):
    """How much moves along the robots' paths."""

    cars: int = Field(0, ge=0, le=1000, description="that drive the other lane towards the robots, on all paths")
    walkers: int = Field(0, ge=0, le=1000, description="people who walk along the roads, either way")
    car_mps: float = Field(8.0, gt=0, le=60, description="m/s, mean speed of cars; each has its own, 20 % around")
    walker_mps: float = Field(1.3, gt=0, le=10, description="m/s, mean speed of walkers, likewise")


@dataclass(frozen=True, eq=False)
class Mover:
    """Something that goes along a path at its own speed, and begins anew at the end.

    Args:
        mesh: its shape, x forward, on z = 0.
        half_m: `(2,)` half its length and width.
        path: its curve on the ground.
        free: `(K,)` where along the path nothing stands in its way; elsewhere it is not there.
        ground: gives its height.
        speed_mps: its speed.
        start_m: how far along the path it is when the mission starts.
    """

    mesh: Mesh
    half_m: FloatArray
    path: GroundPath
    free: BoolArray
    ground: Ground
    speed_mps: float
    start_m: float

    def at(self, stamp_ns: int) -> FloatArray | None:
        """`T_world_mover` `(4, 4)`; None where something stands in its way."""
        gone_m = self.start_m + self.speed_mps * (stamp_ns - START_NS) * 1e-9
        s = gone_m % self.path.length_m
        if not self.free[np.searchsorted(self.path.s_m, s)]:
            return None
        x, y, yaw = (np.interp(s, self.path.s_m, values) for values in (*self.path.xy_m.T, self.path.yaw_rad))
        z = float(self.ground.height(np.array([[x, y]]))[0])
        return np.asarray(se3.from_yaw(yaw, np.array([x, y, z])))

    def covers(self, T_world_mover: FloatArray, positions: FloatArray) -> bool:
        """Whether it would touch a robot at one of the positions `(N, 3)`."""
        own = np.abs(se3.transform(se3.inverse(T_world_mover), positions)[:, :2])
        return bool((own < self.half_m + _MARGIN_M).all(axis=1).any())


@dataclass(frozen=True, eq=False)
class Traffic:
    """All that moves besides the robots.

    Args:
        movers: each with its path.
        robots: motions, which movers do not run into.
    """

    movers: tuple[Mover, ...]
    robots: tuple[Motion, ...]

    @classmethod
    def along(cls, robots: Mapping[str, Motion], scene: Scene, settings: TrafficSettings, seed: int) -> Self:
        """Movers on the robots' paths, spread by chance."""
        rng = np.random.default_rng([seed, 4])
        lines = [line for motion in robots.values() if (line := _centre_line(motion)) is not None]
        movers = []
        for number in range(settings.cars + settings.walkers if lines else 0):
            is_car = number < settings.cars
            line = lines[rng.integers(len(lines))]
            backwards = is_car or bool(rng.integers(2))
            path = _beside(line, _LANE_M if is_car else _ROADSIDE_M, backwards=backwards)
            mesh, half_m = _car(rng) if is_car else _walker(rng)
            mean_mps = settings.car_mps if is_car else settings.walker_mps
            speed_mps, start_m = mean_mps * rng.uniform(0.8, 1.2), rng.uniform(0.0, path.length_m)
            free = _free(path, scene, float(half_m[1]))
            movers.append(Mover(mesh, half_m, path, free, scene.ground, speed_mps, start_m))
        return cls(tuple(movers), tuple(robots.values()))

    def seen(self, T_world_sensor: FloatArray, stamp_ns: int, period_ns: int, reach_m: float) -> Mesh:
        """Everything within reach, each where it is when a turning LiDAR's beams pass over it.

        Args:
            T_world_sensor: `(4, 4)` when the turn starts, with its beams behind, to go round clockwise.
            stamp_ns: then.
            period_ns: of the turn.
            reach_m: how far the sensor sees.
        """
        positions = np.concatenate([motion.T_world_body(np.array([stamp_ns]))[:, :3, 3] for motion in self.robots])
        near = []
        for mover in self.movers:
            T_world_mover = mover.at(stamp_ns)
            if T_world_mover is None:
                continue
            x, y, _ = se3.between(T_world_sensor, T_world_mover)[:3, 3]
            if np.hypot(x, y) > reach_m + mover.half_m[0]:
                continue
            share = (np.pi - np.arctan2(y, x)) / (2.0 * np.pi)
            T_world_mover = mover.at(stamp_ns + round(share * period_ns))
            if T_world_mover is not None and not mover.covers(T_world_mover, positions):
                near.append(mover.mesh.moved(T_world_mover))
        return join(near)


def _centre_line(motion: Motion) -> GroundPath | None:
    """Where a robot drives, evenly sampled; None where it hardly moves."""
    stamps_ns: IntArray = START_NS + np.arange(0, motion.duration_ns, 100_000_000, dtype=np.int64)
    xy = motion.T_world_body(stamps_ns)[:, :2, 3]
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    if s[-1] < 10.0 * _SPACING_M:
        return None
    even = np.linspace(0.0, s[-1], round(s[-1] / _SPACING_M) + 1)
    return GroundPath.smoothed(np.stack([np.interp(even, s, values) for values in xy.T], axis=1), 2.0)


def _beside(line: GroundPath, left_m: float, *, backwards: bool) -> GroundPath:
    """A path so far to the left of another, in its direction or against it."""
    normal = np.stack([-np.sin(line.yaw_rad), np.cos(line.yaw_rad)], axis=1)
    xy, yaw = line.xy_m + left_m * normal, line.yaw_rad
    if backwards:
        xy, yaw = xy[::-1], yaw[::-1] + np.pi
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    return GroundPath(s, xy, yaw)


def _free(path: GroundPath, scene: Scene, half_width_m: float) -> BoolArray:
    middle = np.column_stack([path.xy_m, scene.ground.height(path.xy_m) + _MIDDLE_M])
    return np.asarray(scene.clearance(middle) > min(half_width_m, 0.9 * _MIDDLE_M))


def _car(rng: np.random.Generator) -> tuple[Mesh, FloatArray]:
    length, width, height = rng.uniform(3.8, 5.2), 1.8, rng.uniform(1.4, 2.0)
    return car(length, width, height), np.array([length, width]) / 2


def _walker(rng: np.random.Generator) -> tuple[Mesh, FloatArray]:
    """Legs apart, a body and a head."""
    height = rng.uniform(1.5, 1.95)
    legs = [box(0.14, 0.14, 0.5 * height).at(side * 0.15, side * 0.09) for side in (-1, 1)]
    body = box(0.25, 0.45, 0.35 * height).at(0.0, 0.0, 0.5 * height)
    head = box(0.2, 0.18, 0.13 * height).at(0.0, 0.0, 0.86 * height)
    return join([*legs, body, head]), np.array([0.3, 0.25])
