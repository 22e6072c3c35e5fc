"""Scenario `shell-space`: an empty storey with a grid of identical pillars, after the paper's hardware experiment."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wiclosure.simulation.sensors.lidar import LidarModel
from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.mesh import box, cylinder
from wiclosure.simulation.world.motion import Motion, MotionSettings, Stop, drive
from wiclosure.simulation.world.scene import Footprint, Scene, SceneBuilder

LENGTH_M, WIDTH_M, HEIGHT_M = 25.0, 23.0, 2.8
MOTION = MotionSettings(
    speed_mps=0.5,
    acceleration_mps2=0.4,
    lateral_mps2=0.4,
    turn_rate_rps=0.8,
    corner_m=0.8,
    sensor_height_m=1.0,
    sway_deg=0.5,
)
"""The LiDAR stands on a mast: from close to the floor a VLP-16 cut to 10 m sees no ceiling, and KISS-ICP's pitch drifts
by a degree a metre (measured)."""

LIDAR_RANGE_M = 10.0
LIDAR_RATE_HZ = 5.0

_PILLAR_M = 0.9
_COLUMNS_M, _ROWS_M = (-7.5, -2.5, 2.5, 7.5), (-7.2, -2.4, 2.4, 7.2)
_BEAM_M = (0.4, 0.5)
_OPENINGS_M = (-4.9, 0.0, 4.9)
_ALPHA_M = np.array([(-5.2, -9.6), (-5.0, 0.2), (0.2, 0.7), (0.0, 9.3), (9.8, 9.0), (9.8, -2.0)])
_BETA_M = np.array([(10.2, -9.6), (0.6, -9.4), (0.9, -0.9), (5.2, -0.4), (5.2, 9.4), (-5.0, 9.8)])


def scene(rng: np.random.Generator, aliasing: float) -> Scene:
    """The storey; a share `1 - aliasing` of the pillars is round or of other size."""
    builder = SceneBuilder(rough_ground(rng, (-14.0, -13.0), (14.0, 13.0), 0.004, wavelengths_m=(4.0, 20.0)))
    for x_m in _COLUMNS_M:
        for y_m in _ROWS_M:
            if rng.random() < aliasing:
                builder.stand(box(_PILLAR_M, _PILLAR_M, HEIGHT_M), x_m, y_m)
            else:
                size = rng.uniform(0.4, 1.1)
                shape = (
                    cylinder(size / 2, HEIGHT_M, 14)
                    if rng.random() < 0.5
                    else box(size, rng.uniform(0.4, 1.1), HEIGHT_M)
                )
                builder.stand(shape, x_m + rng.uniform(-0.5, 0.5), y_m + rng.uniform(-0.5, 0.5))
    for length_m, depth_m, yaw in (
        (LENGTH_M + 0.6, WIDTH_M / 2, 0.0),
        (WIDTH_M, LENGTH_M / 2, np.pi / 2),
        (LENGTH_M + 0.6, WIDTH_M / 2, np.pi),
        (WIDTH_M, LENGTH_M / 2, -np.pi / 2),
    ):
        _wall(builder, length_m, depth_m + 0.15, yaw)
    _ceiling(builder)
    return builder.build()


def _ceiling(builder: SceneBuilder) -> None:
    """A slab on beams that run from pillar to pillar."""
    builder.hang(box(LENGTH_M + 0.6, WIDTH_M + 0.6, 0.2).at(0, 0, HEIGHT_M))
    for x_m in _COLUMNS_M:
        builder.hang(box(_BEAM_M[0], WIDTH_M, _BEAM_M[1]).at(x_m, 0, HEIGHT_M - _BEAM_M[1]))
    for y_m in _ROWS_M:
        builder.hang(box(LENGTH_M, _BEAM_M[0], _BEAM_M[1]).at(0, y_m, HEIGHT_M - _BEAM_M[1]))


def _wall(builder: SceneBuilder, length_m: float, depth_m: float, yaw: float) -> None:
    """A bare wall at `depth_m` from the middle: half-pillars in line with the pillars, openings between them."""
    edges = np.array([-length_m / 2, *np.repeat(_OPENINGS_M, 2) + np.tile([-0.8, 0.8], 3), length_m / 2])
    for start, end in edges.reshape(-1, 2):
        along, size = (start + end) / 2, Footprint(end - start, 0.3, HEIGHT_M)
        x_m, y_m = np.cos(yaw) * along - np.sin(yaw) * depth_m, np.sin(yaw) * along + np.cos(yaw) * depth_m
        builder.building(box(size.length_m, size.width_m, HEIGHT_M), size, x_m, y_m, yaw)
    for along in (-7.4, -2.4, 2.4, 7.4):
        x_m, y_m = np.cos(yaw) * along - np.sin(yaw) * depth_m, np.sin(yaw) * along + np.cos(yaw) * depth_m
        builder.stand(box(_PILLAR_M, 1.2, HEIGHT_M), x_m, y_m, yaw)


def robots(world: Scene, count: int) -> dict[str, Motion]:
    """Two drives of some 43 m that meet in the middle and in the north-east."""
    paths = (("alpha", _ALPHA_M, 0.0), ("beta", _BETA_M, 2.0))
    return {
        name: drive(waypoints, world.ground, MOTION, (Stop(15.0, 3.0),), start_s)
        for name, waypoints, start_s in paths[:count]
    }


def lidar(model: LidarModel) -> LidarModel:
    """The same LiDAR, cut to 10 m as in the paper, turning slowly."""
    return replace(model, rate_hz=LIDAR_RATE_HZ, max_range_m=LIDAR_RANGE_M)
