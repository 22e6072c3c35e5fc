"""Buildings in a row."""

from __future__ import annotations

import numpy as np

from wiclosure.simulation import make_scenario


def test_campus_has_neighbours_that_meet_and_others_that_never_do() -> None:
    scenario = make_scenario("campus")
    positions = [scenario.ground_truth(robot).positions for robot in scenario.robots]
    apart = np.array([[np.linalg.norm(a[:, None] - b[None], axis=2).min() for b in positions] for a in positions])
    assert (apart[[0, 1, 2], [1, 2, 3]] < 5).all()
    assert apart[0, 2] > 30
    assert (apart[4, :4] > 100).all()
