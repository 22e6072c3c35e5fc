"""Robots that hardly move, a block between them and a wall beside them."""

from __future__ import annotations

import numpy as np

from wiclosure.simulation import make_scenario
from wiclosure.simulation.sensors.propagation import InScene


def test_the_direct_path_is_blocked_and_the_wall_in_the_north_mirrors_all_the_time() -> None:
    scenario = make_scenario("static-mirror")
    alpha, beta = (scenario.ground_truth(robot).positions for robot in scenario.robots)
    assert max(np.ptp(positions, axis=0).max() for positions in (alpha, beta)) < 5
    count = min(len(alpha), len(beta))
    propagation = InScene(scenario.scene)
    assert propagation.blocked(alpha[:count], beta[:count]).all()
    found = propagation.reflections(alpha[:count], beta[:count])
    in_the_north = found.virtual_m[:, 1] > 20
    assert set(found.transmission[in_the_north].tolist()) == set(range(count))
