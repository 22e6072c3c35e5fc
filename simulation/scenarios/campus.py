"""Scenario `campus`: large buildings in a row; neighbours share a walkway, others never meet."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wiclosure.simulation.sensors.lidar import LidarModel
from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.mesh import box, cylinder, gable, join, pole, tree
from wiclosure.simulation.world.motion import Motion, MotionSettings, Stop, drive
from wiclosure.simulation.world.scene import Footprint, Scene, SceneBuilder

NAMES = ("alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta")
MOTION = MotionSettings(
    speed_mps=3.0, acceleration_mps2=1.0, lateral_mps2=1.2, turn_rate_rps=0.8, corner_m=4.0, sensor_height_m=1.1
)
LIDAR_RATE_HZ = 5.0

_PITCH_M = 50.0
_HALF_DEPTH_M = 22.0
_DETACHED_M = 130.0


def _centres(count: int) -> list[float]:
    """Where along x each robot's building stands; from five robots on, the last is far from all."""
    row = [_PITCH_M * index for index in range(count)]
    if count >= 5:
        row[-1] += _DETACHED_M
    return row


def scene(rng: np.random.Generator, count: int, aliasing: float) -> Scene:
    """One building per robot, alike with the probability `aliasing`, with lawns, trees and lamps around."""
    centres = _centres(count)
    builder = SceneBuilder(
        rough_ground(rng, (-100.0, -100.0), (centres[-1] + 100, 100.0), 0.8, cell_m=2.0, wavelengths_m=(8.0, 120.0))
    )
    common = np.random.default_rng(5)
    template = common.bit_generator.state
    for x_m in centres:
        common.bit_generator.state = template
        _block(builder, common if rng.random() < aliasing else rng.spawn(1)[0], x_m)
        for y_m in (-52.0, 52.0):
            size = Footprint(rng.uniform(15, 30), rng.uniform(10, 16), rng.uniform(5, 14))
            builder.building(
                box(size.length_m, size.width_m, size.height_m),
                size,
                x_m + rng.uniform(-8, 8),
                y_m,
                rng.uniform(-0.2, 0.2),
            )
    return builder.build()


def _block(builder: SceneBuilder, rng: np.random.Generator, x_m: float) -> None:
    """A main building with wings, a stair tower, trees and lamps."""
    main = Footprint(rng.uniform(20, 28), rng.uniform(12, 18), rng.uniform(7, 13))
    roof = gable(main.length_m + 1, main.width_m + 1, rng.uniform(1, 4)).at(0, 0, main.height_m)
    builder.building(join([box(main.length_m, main.width_m, main.height_m), roof]), main, x_m, 0.0)
    for side in (-1, 1):
        wing = Footprint(rng.uniform(5, 9), rng.uniform(4, 8), rng.uniform(3, 7))
        builder.building(
            box(wing.length_m, wing.width_m, wing.height_m),
            wing,
            x_m + rng.uniform(-7, 7),
            side * (main.width_m / 2 + wing.width_m / 2),
        )
    builder.stand(cylinder(rng.uniform(1, 2), main.height_m + 2, 14), x_m + main.length_m / 2, rng.uniform(-4, 4))
    for _ in range(9):
        height = rng.uniform(4, 9)
        y_m = rng.choice([-1, 1]) * rng.uniform(28, 40)
        builder.plant(tree(rng, height, 0.3 * height, 90), x_m + rng.uniform(-22, 22), y_m)
    for offset in (-18.0, -2.0, 14.0):
        builder.plant(pole(5.0, 0.08, 0.6), x_m + offset + rng.uniform(-2, 2), rng.choice([-25.5, 25.5]))


def robots(world: Scene, count: int) -> dict[str, Motion]:
    """Each robot once around its building, every other one the other way round; the walkway between two is shared."""
    drives: dict[str, Motion] = {}
    for index, (name, x_m) in enumerate(zip(NAMES[:count], _centres(count), strict=True)):
        west, east, south, north = x_m - 24.0, x_m + 24.0, -_HALF_DEPTH_M, _HALF_DEPTH_M
        loop = np.array(
            [(x_m, south), (east, south), (east, north), (west, north), (west, south), (x_m - 6, south + 0.8)]
        )
        if index % 2:
            loop = loop[::-1]
        drives[name] = drive(loop, world.ground, MOTION, (Stop(40.0, 2.0),), start_s=0.7 * index)
    return drives


def lidar(model: LidarModel) -> LidarModel:
    """The same LiDAR, turning slowly."""
    return replace(model, rate_hz=LIDAR_RATE_HZ)
