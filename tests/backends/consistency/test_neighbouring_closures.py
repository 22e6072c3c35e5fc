"""Closures against their neighbours along both paths."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise
from wiclosure.backends.consistency.merging import MergedGroups
from wiclosure.backends.consistency.neighbouring_closures import robots_in_contradiction
from wiclosure.backends.least_squares.settling import Settled
from wiclosure.backends.least_squares.team_arrays import TeamArrays

NOISE = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
SHIFT = np.array([0.0, 0.0, 0.0, 6.0, 0.0, 0.0])


def said(team, closures, scale=1.0):
    """Of all of them, accepted, with standard deviations so many times as large."""
    sets, _ = closure_sets(closures, team.odometry, NOISE)
    arrays = TeamArrays.of(team.odometry, sets, np.zeros(len(closures), bool))
    count, settled = len(arrays.robots.loops), Settled(arrays.robots.poses, *(np.zeros(0),) * 4)
    merged = MergedGroups(
        np.ones(count, bool), np.zeros(3, int), {}, [], settled, np.full(2, scale), odometry_factors=np.ones(3)
    )
    return robots_in_contradiction(arrays, merged)


def along(team, rng, shares, robots=("alpha", "beta")):
    """Closures between the same keyframes of both; this share of them shifted."""
    return [
        team.closure((robots[0], n), (robots[1], n), noise=rng, error=SHIFT * (rng.uniform() < shares))
        for n in range(1, 59)
    ]


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
@pytest.mark.parametrize(("share", "contradict"), [(0.0, False), (0.4, True), (1.0, False)])
def test_closures_that_contradict_their_neighbours_are_told_under_any_scale(team_maker, share, contradict, scale):
    team, rng = team_maker(3, ("alpha", "beta", "gamma"), noise=1.0), np.random.default_rng(3)
    closures = [*along(team, rng, 0.0, ("beta", "gamma")), *along(team, rng, share)]
    assert said(team, closures, scale) == (("alpha", "beta") if contradict else None)


def test_loops_within_a_robot_are_compared_too(team_maker):
    team, rng = team_maker(3, ("alpha", "beta", "gamma"), noise=1.0), np.random.default_rng(3)
    own = [team.closure(("gamma", n), ("gamma", n + 25), noise=rng, error=SHIFT * (n % 3 == 0)) for n in range(1, 30)]
    assert said(team, own) == ("gamma", "gamma")


def test_measurements_without_noise_contradict_nothing(team_maker):
    team = team_maker(3, ("alpha", "beta", "gamma"))
    closures = [team.closure(("alpha", n), ("beta", n), error=1e-9 * SHIFT * (n % 3 == 0)) for n in range(1, 59)]
    assert said(team, closures) is None
    assert said(team, closures[:10]) is None
