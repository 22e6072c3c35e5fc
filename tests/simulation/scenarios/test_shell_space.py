"""The hall of the paper's hardware experiment."""

from __future__ import annotations

import numpy as np

from wiclosure.simulation import make_scenario


def test_shell_space_is_the_papers_experiment() -> None:
    scenario = make_scenario("shell-space")
    log = scenario.wireless()
    assert [len(measurement.paths) for measurement in log.measurements] == [5, 5, 5, 5]
    assert {heading.robot for heading in log.headings} == {"alpha", "beta"}
    scan = next(iter(scenario.scan_source("alpha")))
    assert np.linalg.norm(scan.points, axis=1).max() <= 10.0
