from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent

ROBOTS = ("alpha", "beta", "gamma")
T_WRONG = se3.from_yaw(0.4, np.array([30.0, 0.0, 0.0]))


def stretch(team, rng, reach):
    """True closures of alpha and beta along so many keyframes of both, from where they are near each other."""
    along = np.linspace(0, reach, 15).astype(int).tolist()
    return [team.closure(("alpha", 6 + n), ("beta", 25 + n), noise=rng) for n in along]


def at_one_place(team, rng, other):
    """Six closures of alpha and another robot that agree, and are all wrong."""
    alpha, poses = team.truth["alpha"].poses, team.truth[other].poses
    return [
        team.remeasured(c, T_query_match=se3.between(alpha[n], T_WRONG @ poses[n]))
        for n in range(120, 126)
        for c in [team.closure(("alpha", n), (other, n), noise=rng)]
    ]


@pytest.mark.parametrize(("reach", "doubted"), [(16, True), (100, False)])
def test_a_short_stretch_is_in_doubt_where_another_place_agrees_as_well(team_maker, reach, doubted):
    """What lies at one place may be a look-alike, but so may what lies within little more than a view."""
    team, rng = team_maker(4, ROBOTS, n=150, noise=1.0), np.random.default_rng(4)
    closures = [*stretch(team, rng, reach), *at_one_place(team, rng, "beta")]
    found = pairwise_consistent(closures, team.odometry, PcmSettings())
    assert found.pairs[0].kept == 15
    assert found.pairs[0].rival == 6 * doubted


@pytest.mark.parametrize(("reach", "doubted"), [(16, True), (100, False)])
def test_so_it_is_where_the_other_place_is_one_of_a_third_robot(team_maker, reach, doubted):
    """Alpha and gamma are joined over beta: no more surely than by the weaker of the two sets."""
    team, rng = team_maker(4, ROBOTS, n=150, noise=1.0), np.random.default_rng(4)
    joined = [*stretch(team, rng, reach), *team.random_closures(30, rng, "beta", "gamma", noise=rng)]
    found = pairwise_consistent([*joined, *at_one_place(team, rng, "gamma")], team.odometry, PcmSettings())
    assert sorted((pair.kept, pair.rival) for pair in found.pairs) == [(0, 6 * doubted), (15, 0), (30, 0)]
    (refused,) = (pair for pair in found.pairs if not pair.kept)
    assert ("6 closures agree with each other, but contradict accepted ones" in refused.doubt) == doubted
