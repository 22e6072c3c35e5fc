from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise, PcmSettings
from wiclosure.backends.consistency.explanation import Explanation
from wiclosure.backends.consistency.pcm import merge_settings
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.backends.sets.alignment import ClosureComparison

ROBOTS = ("alpha", "beta", "gamma")
EXACT = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)


@pytest.fixture
def compared(monkeypatch):
    """How many closures each comparison is of."""
    counts, compare = [], ClosureComparison.of

    def counting(claims, beyond):
        counts.append(len(claims))
        return compare(claims, beyond)

    monkeypatch.setattr(ClosureComparison, "of", counting)
    return counts


def robots_of(team_maker):
    """Three robots with 12, 13 and 14 closures between each two, in the order of their names."""
    team, rng = team_maker(4, ROBOTS, noise=1.0), np.random.default_rng(4)
    pairs = (("alpha", "beta", 12), ("alpha", "gamma", 13), ("beta", "gamma", 14))
    closures = [
        team.closure((a, int(i)), (b, int(j)), noise=rng)
        for a, b, count in pairs
        for i, j in rng.integers(0, 60, (count, 2))
    ]
    sets, _ = closure_sets(closures, team.odometry, EXACT)
    return TeamArrays.of(team.odometry, sets, np.zeros(len(closures), bool))


def test_each_two_robots_are_compared_once_for_the_scale_of_sigma_and_for_their_sets(team_maker, compared):
    arrays = robots_of(team_maker)
    settings = merge_settings(PcmSettings(noise=EXACT, max_scale=10.0))
    found = Explanation.of(arrays.robots, settings)
    assert found.merged.scale == 1.0
    assert sorted(compared)[:3] == [12, 13, 14]
    assert all(count > 14 for count in sorted(compared)[3:])  # groups of robots


@pytest.mark.parametrize("max_scale", [1.0, 10.0])
def test_a_cut_compares_what_it_touches_alone_and_decides_as_if_all_were_new(team_maker, compared, max_scale):
    arrays = robots_of(team_maker)
    settings = merge_settings(PcmSettings(noise=EXACT, max_scale=max_scale))
    found, robot = Explanation.of(arrays.robots, settings), arrays.names.index("alpha")
    node = int(np.flatnonzero(arrays.robots.robot == robot)[10])
    untouched = int((arrays.robots.robot[arrays.robots.loop_ends] != robot).all(axis=0).sum())
    assert untouched == 14
    compared.clear()
    cut = found.cut(node, settings)
    assert untouched not in compared
    anew = Explanation.of(arrays.robots.cut(node), settings)
    assert untouched in compared
    np.testing.assert_array_equal(cut.merged.inlier, anew.merged.inlier)
    np.testing.assert_array_equal(cut.merged.group, anew.merged.group)
    assert cut.cost(settings) == pytest.approx(anew.cost(settings), rel=1e-6)
