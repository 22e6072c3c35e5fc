"""The one thing that must not happen: certain, and wrong, under systematic errors (`benchmarks/systematic.py`)."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

import systematic

from wiclosure.wiclosure_filter.filter import WiClosureFilter

TRIALS = 3


def scored(fault: systematic.Fault, worlds: tuple[str, ...]) -> systematic.Score:
    score = systematic.Score()
    for number, world in enumerate(worlds):
        for trial in range(TRIALS):
            rng = np.random.default_rng([40, number, trial])
            case = systematic.make(systematic.WORLDS[world](fault.robots, rng), fault, rng)
            result = WiClosureFilter().candidates(case.odometry, case.log)
            systematic.count_outcome(case, result, fault, score)
    return score


@pytest.mark.slow
@pytest.mark.parametrize("fault", systematic.FAULTS[:3], ids=lambda fault: fault.name)
def test_honest_radio_stays_certain(fault: systematic.Fault) -> None:
    """But where robots move in parallel along an aisle, or where reversed azimuths fit nearly as well, as one does."""
    score = scored(fault, ("site", "roaming"))
    assert score.certain >= 2 * TRIALS - 1
    assert score.wrong == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "azimuth clockwise",
        "azimuth from the left",
        "azimuth reversed",
        "odometry y right",
        "ids swapped",
        "ranges in feet",
    ],
)
def test_blunders_are_named_and_nothing_is_certain(name: str) -> None:
    """But where robots move in parallel: those leave nothing to tell a mirror image by."""
    (fault,) = [one for one in systematic.FAULTS if one.name == name]
    score = scored(fault, ("site", "roaming"))
    assert score.wrong <= 1
    assert score.certain <= 2
    assert not fault.words or (score.named >= 3 and score.listed >= 4)
