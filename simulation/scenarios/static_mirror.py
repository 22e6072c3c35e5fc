"""Scenario `static-mirror`: robots that hardly move, and a wall that shows each a virtual transmitter all the time."""

from __future__ import annotations

import numpy as np

from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.mesh import box
from wiclosure.simulation.world.motion import Motion, MotionSettings, Stop, drive
from wiclosure.simulation.world.scene import Footprint, Scene, SceneBuilder

MOTION = MotionSettings(
    speed_mps=0.4, acceleration_mps2=0.4, lateral_mps2=0.4, turn_rate_rps=0.8, corner_m=0.5, sensor_height_m=0.6
)


def scene(rng: np.random.Generator) -> Scene:
    """A long wall in the north, and a block between the robots."""
    builder = SceneBuilder(rough_ground(rng, (-45.0, -35.0), (45.0, 35.0), 0.05))
    builder.building(box(60.0, 0.4, 5.0), Footprint(60.0, 0.4, 5.0), 0.0, 12.0)
    builder.building(box(7.0, 9.0, 4.0), Footprint(7.0, 9.0, 4.0), 0.5, -1.0, 0.15)
    for _ in range(10):
        builder.stand(box(*rng.uniform(0.5, 2.0, 3).tolist()), rng.uniform(-25, 25), rng.uniform(-25, -12))
    return builder.build()


def robots(world: Scene, count: int) -> dict[str, Motion]:
    """Each robot creeps 4 m, with long pauses."""
    paths = (
        ("alpha", np.array([(-15.0, 0.0), (-13.0, 0.3), (-11.0, 0.2)])),
        ("beta", np.array([(14.0, 1.5), (12.5, 0.0), (10.8, -0.8)])),
    )
    return {
        name: drive(waypoints, world.ground, MOTION, (Stop(1.2, 20.0), Stop(2.6, 20.0)))
        for name, waypoints in paths[:count]
    }
