"""Scenario `city`: a few blocks of streets, lined with houses that may look alike."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from wiclosure.simulation.world.ground import rough_ground
from wiclosure.simulation.world.motion import GroundPath, Motion, MotionSettings, Stop, drive
from wiclosure.simulation.world.scene import Scene, SceneBuilder
from wiclosure.simulation.world.streets import line_with_lots
from wiclosure.types import FloatArray

MOTION = MotionSettings(
    speed_mps=9.0, acceleration_mps2=1.6, lateral_mps2=2.2, turn_rate_rps=0.6, corner_m=7.0, sensor_height_m=1.7
)
_X_M, _Y_M = (0.0, 95.0, 190.0), (0.0, 75.0, 150.0)

_LANE_M = 1.6
_PATHS_M = {
    "alpha": [(5, 0), (95, 0), (95, 75), (0, 75), (0, 150), (85, 150)],
    "beta": [(185, 150), (95, 150), (95, 75), (95, 0), (190, 0), (190, 65)],
    "gamma": [(0, 10), (0, 75), (95, 75), (190, 75), (190, 150), (105, 150)],
}


def scene(rng: np.random.Generator, aliasing: float) -> Scene:
    """Streets in a grid, two by two blocks."""
    builder = SceneBuilder(
        rough_ground(rng, (-90.0, -90.0), (280.0, 240.0), 0.8, cell_m=2.0, wavelengths_m=(10.0, 160.0))
    )
    across = [GroundPath.through(np.array([(x, _Y_M[0] - 15), (x, _Y_M[-1] + 15)]), 1.0) for x in _X_M]
    along = [GroundPath.through(np.array([(_X_M[0] - 15, y), (_X_M[-1] + 15, y)]), 1.0) for y in _Y_M]
    line_with_lots(builder, along + across, rng, aliasing)
    return builder.build()


def robots(world: Scene, count: int) -> dict[str, Motion]:
    """Drives of 360 m or more through the grid; each shares streets with the others, some in the other direction."""
    stops = (Stop(70.0, 3.0), Stop(210.0, 2.0))
    return {
        name: drive(_right_lane(np.array(path, float)), world.ground, MOTION, stops)
        for name, path in list(_PATHS_M.items())[:count]
    }


def _right_lane(waypoints_m: FloatArray) -> FloatArray:
    """The polyline moved to the right-hand lane."""
    leg = np.diff(waypoints_m, axis=0)
    leg /= np.linalg.norm(leg, axis=1, keepdims=True)
    right = np.stack([leg[:, 1], -leg[:, 0]], axis=1)
    # At a right-angled corner the shifts of both legs add up.
    shift = np.vstack([right[:1], np.where(_turns(leg)[:, None], right[1:] + right[:-1], right[1:]), right[-1:]])
    return waypoints_m + _LANE_M * shift


def _turns(leg: FloatArray) -> NDArray[np.bool_]:
    return np.asarray(np.abs(leg[:-1, 0] * leg[1:, 1] - leg[:-1, 1] * leg[1:, 0]) > 0.5)
