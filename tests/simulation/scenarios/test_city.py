"""Blocks of houses, some of them alike."""

from __future__ import annotations

import numpy as np

from wiclosure.simulation import ScenarioSettings, make_scenario


def test_aliasing_makes_houses_alike() -> None:
    def spread(aliasing: float) -> float:
        walls = make_scenario("city", ScenarioSettings(aliasing=aliasing)).scene.reflectors
        return float(np.std([np.linalg.norm(wall.end_m - wall.start_m) for wall in walls[::4]]))

    assert spread(1.0) < 1e-3
    assert spread(0.0) > 0.5
