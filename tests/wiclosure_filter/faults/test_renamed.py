"""Geometry refutes names that the measurements cannot have, and no others."""

from __future__ import annotations

from itertools import permutations

import numpy as np

from wiclosure.types import WirelessLog
from wiclosure.wiclosure_filter.faults.diagnosis import LIKELIER
from wiclosure.wiclosure_filter.faults.renamed import Displacements, missed
from wiclosure.wiclosure_filter.filter import WiClosureFilter

from .test_diagnosis import heard, team
from .test_whole_log import STEPS, Trajectory, drive
from .test_whole_log import heard as heard_by

STAMPS_NS = np.arange(STEPS, dtype=np.int64) * 10**9


def against(trajectories: dict[str, Trajectory], log: WirelessLog) -> dict[str, float]:
    """Odds against each order of the names."""
    chosen = WiClosureFilter()
    links = chosen.gather(trajectories, log).by_pair
    told = [Displacements.of(one, links[pair]) for pair, one in chosen.align(trajectories, links).items()]
    robots = list(trajectories)
    return {
        "".join(order): missed(told, dict(zip(robots, order, strict=True)), trajectories)
        for order in permutations(robots)
    }


def test_names_of_robots_that_wind_about_can_only_be_theirs() -> None:
    odometry, truth = team("abc")
    odds = against(odometry, heard(truth))
    assert odds.pop("abc") == 0.0
    assert min(odds.values()) > 2 * LIKELIER


def test_robots_that_drive_in_parallel_can_have_any_names() -> None:
    robots = {name: Trajectory(name, STAMPS_NS, drive(0.0, (0.0, 8.0 * n))) for n, name in enumerate("abc")}
    pairs = (("a", "b"), ("b", "c"), ("a", "c"))
    log = WirelessLog(tuple(m for a, b in pairs for m in heard_by(robots[a], robots[b], reverse=False)))
    assert max(against(robots, log).values()) < 2 * LIKELIER
