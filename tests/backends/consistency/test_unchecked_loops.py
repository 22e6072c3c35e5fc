"""Loops within a robot whose odometry says too little of itself to refute any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure.backends.config import ClosureNoise, PcmSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent

SETTINGS = PcmSettings(noise=ClosureNoise(translation_m=1e-6, rotation_rad=1e-6))


@pytest.mark.parametrize(("vague", "doubted"), [(1.0, False), (1000.0, True)])
def test_loops_that_would_be_accepted_anywhere_put_the_map_in_doubt(team_maker, vague, doubted):
    team, rng = team_maker(3, ("alpha",), noise=1.0), np.random.default_rng(3)
    ends = [(int(i), int(j)) for i, j in np.sort(rng.integers(0, 60, (30, 2)), axis=1) if j - i > 5]
    closures = [team.closure(("alpha", i), ("alpha", j), noise=rng) for i, j in ends[:8]]
    odometry = {"alpha": replace(team.odometry["alpha"], drift=team.odometry["alpha"].drift.scaled(vague))}
    found = pairwise_consistent(closures, odometry, SETTINGS)
    assert found.pairs[0].kept == len(closures)
    assert [said.partition(";")[0] for said in found.doubts] == [
        "alpha: the map may be wrong: closures within its path are accepted, but its odometry is taken so vaguely that"
        f" {found.unchecked['alpha']:.0%} of false ones would be too"
        for _ in range(doubted)
    ]


def test_closures_between_robots_alone_are_none_of_them(team_maker):
    team, rng = team_maker(4, noise=1.0), np.random.default_rng(4)
    closures = [team.closure(("alpha", int(i)), ("beta", int(j)), noise=rng) for i, j in rng.integers(0, 60, (12, 2))]
    assert pairwise_consistent(closures, team.odometry, SETTINGS).unchecked == {}
