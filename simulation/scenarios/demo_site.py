"""Scenario `demo-site`: two vehicles on a small works yard with two look-alike halls."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wiclosure.simulation.sensors.lidar import LidarModel
from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.mesh import Mesh, box, car, cylinder, gable, join, pole, tree
from wiclosure.simulation.world.motion import Motion, MotionSettings, Stop, drive
from wiclosure.simulation.world.scene import Footprint, Scene, SceneBuilder
from wiclosure.types import FloatArray

MOTION = MotionSettings(
    speed_mps=4.5, acceleration_mps2=1.5, lateral_mps2=2.2, turn_rate_rps=0.9, corner_m=4.0, sensor_height_m=1.6
)
LIDAR_RATE_HZ = 5.0
"""Slow turns keep the demo short: a scan every 0.9 m at most."""

_ALPHA_M = np.array(
    [(-26, 6), (-26, 15), (-4, 15.5), (-3.5, -6), (-22, -8.5), (-25, -16.5), (-4, -17), (8, -17.5), (15, -17)]
)
_BETA_M = np.array(
    [
        (24, 13.5),
        (14, 15.5),
        (3.5, 15),
        (3, 0),
        (4.5, -6),
        (22, -8),
        (26, -15),
        (20, -17.5),
        (6, -17),
        (-6, -17),
        (-12, -17.5),
    ]
)


def scene(rng: np.random.Generator, aliasing: float) -> Scene:
    """The yard, 60 x 40 m. The two halls and the two sheds are alike with the probability `aliasing`."""
    builder = SceneBuilder(rough_ground(rng, (-75.0, -65.0), (75.0, 65.0), roughness_m=0.35))
    twin = rng.random(2) < aliasing
    for centre_m, alike in ((-14.5, True), (14.5, bool(twin[0]))):
        _hall(builder, centre_m, 4.5, Footprint(14.0, 10.0, 6.0) if alike else Footprint(11.0, 12.0, 8.0))
    for centre_m, alike in ((-14.0, True), (14.0, bool(twin[1]))):
        size = Footprint(8.0, 3.0, 3.0) if alike else Footprint(5.0, 3.5, 4.2)
        builder.building(_house(size, 1.2), size, centre_m, -12.5)
    _surroundings(builder, rng)
    _clutter(builder, rng)
    return builder.build()


def robots(world: Scene, count: int) -> dict[str, Motion]:
    """Alpha's drive around the western hall, beta's around the eastern; both cross the middle and the southern yard."""
    paths: list[tuple[str, FloatArray, float, Stop]] = [
        ("alpha", _ALPHA_M, 0.0, Stop(60.0, 1.0)),
        ("beta", _BETA_M, 0.6, Stop(50.0, 1.0)),
    ]
    return {
        name: drive(waypoints, world.ground, MOTION, (stop,), start_s)
        for name, waypoints, start_s, stop in paths[:count]
    }


def lidar(model: LidarModel) -> LidarModel:
    """The same LiDAR, turning slowly."""
    return replace(model, rate_hz=LIDAR_RATE_HZ)


def _house(size: Footprint, roof_m: float) -> Mesh:
    walls = box(size.length_m, size.width_m, size.height_m)
    roof = gable(size.length_m + 0.6, size.width_m + 0.6, roof_m).at(0, 0, size.height_m)
    return join([walls, roof])


def _hall(builder: SceneBuilder, x_m: float, y_m: float, size: Footprint) -> None:
    """A hall with buttresses, a porch and a roof."""
    half_length, half_width = size.length_m / 2, size.width_m / 2
    buttresses = [
        box(0.5, 0.5, size.height_m).at(x, side * (half_width + 0.2))
        for x in np.linspace(-half_length + 1, half_length - 1, 5)
        for side in (-1, 1)
    ]
    porch = box(3.0, 2.0, 2.8).at(-half_length / 3, -half_width - 1.0)
    builder.building(join([_house(size, 1.5), porch, *buttresses]), size, x_m, y_m)


def _surroundings(builder: SceneBuilder, rng: np.random.Generator) -> None:
    """A wall around half of the yard, neighbours' houses and trees behind it."""
    fence = Footprint(60.0, 0.3, 2.2)
    builder.building(box(60.0, 0.3, 2.2), fence, 0.0, 20.5)
    builder.building(box(40.0, 0.3, 2.2), Footprint(40.0, 0.3, 2.2), -31.0, 0.0, np.pi / 2)
    for x_m, y_m, yaw in (
        (-48, 30, 0.2),
        (-12, 34, -0.1),
        (20, 36, 0.4),
        (45, 22, 1.4),
        (48, -14, 1.7),
        (10, -38, 0.1),
    ):
        size = Footprint(rng.uniform(9, 18), rng.uniform(8, 12), rng.uniform(4, 9))
        builder.building(_house(size, rng.uniform(1.0, 3.0)), size, x_m, y_m, yaw)
    for _ in range(26):
        angle, radius = rng.uniform(0, 2 * np.pi), rng.uniform(1.0, 1.35)
        height = rng.uniform(4, 9)
        builder.plant(tree(rng, height, 0.3 * height), 37 * radius * np.cos(angle), 29 * radius * np.sin(angle))


def _clutter(builder: SceneBuilder, rng: np.random.Generator) -> None:
    """Lamp posts, parked cars, tanks, containers and pallets inside the yard."""
    for lamp_m in (-20.0, -7.0, 7.0, 20.0):
        builder.plant(pole(7.0, 0.1, 1.2), lamp_m, 18.5)
        builder.plant(pole(7.0, 0.1, 1.2), lamp_m + 2, -10.5)
    for x_m, y_m, yaw in (
        (-8.0, -14.0, 0.1),
        (8.0, -13.8, -0.1),
        (27.5, 3.0, 1.6),
        (-20.0, 12.0, 0.0),
        (9.5, 12.0, 0.02),
    ):
        builder.stand(car(), x_m, y_m, yaw)
    builder.stand(cylinder(2.0, 5.0, 20), 0.2, 5.0)
    builder.stand(cylinder(1.2, 3.5, 16), -29.0, -12.0)
    container = Footprint(6.0, 2.4, 2.6)
    for x_m, y_m, yaw in ((28.6, -4.0, 1.57), (-0.5, -12.0, 0.4), (29.0, 19.0, 0.0)):
        builder.building(box(6.0, 2.4, 2.6), container, x_m, y_m, yaw)
    for _ in range(14):
        size = rng.uniform(0.4, 1.2, 3)
        row_m = rng.choice([-19.7, 19.2, -14.6]) + rng.uniform(-0.3, 0.3)
        builder.stand(box(*size.tolist()), rng.uniform(-22, 22), row_m, rng.uniform(0, np.pi))
