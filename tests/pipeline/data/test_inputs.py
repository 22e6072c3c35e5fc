from __future__ import annotations

import numpy as np

from wiclosure.pipeline.data.inputs import Inputs, RobotInput
from wiclosure.simulation.scenarios.registry import ScenarioSettings, make_scenario
from wiclosure.types import Trajectory, WirelessLog


def test_ground_truth_is_that_of_the_robots_that_have_it() -> None:
    source = make_scenario("static-mirror", ScenarioSettings()).scan_source("alpha")
    truth = Trajectory("beta", np.arange(2) * 10**9, np.tile(np.eye(4), (2, 1, 1)))
    inputs = Inputs((RobotInput("alpha", source, 1, None), RobotInput("beta", source, 2, truth)), WirelessLog())
    assert inputs.ground_truth == {"beta": truth}
