from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency.pair_report import PairConsistency, doubt_of_neighbours
from wiclosure.backends.consistency.pcm import pairwise_consistent

EVERY_METHOD = [PcmSettings(), PcmSettings(method="clique"), PcmSettings(metric="unit", unit_threshold=1.0)]


def closures_of(team):
    """Five true ones between the robots, a false one, and one within a robot."""
    rng = np.random.default_rng(0)
    ends = [(2, 50), (15, 30), (28, 7), (40, 58), (55, 20)]
    found = [team.closure(("beta", j), ("alpha", i)) for i, j in ends]
    return [*found, team.false_closure(("alpha", 20), ("beta", 20), rng), team.closure(("alpha", 3), ("alpha", 44))]


@pytest.mark.parametrize("settings", EVERY_METHOD, ids=lambda s: f"{s.method}-{s.metric}")
def test_figures_of_a_report_are_those_of_the_closures(team_maker, settings):
    team = team_maker(0)
    result = pairwise_consistent(closures_of(team), team.odometry, settings)
    pair = next(p for p in result.pairs if p.robot_a != p.robot_b)
    assert isinstance(pair, PairConsistency)
    assert {pair.robot_a, pair.robot_b} == {"alpha", "beta"}
    assert (pair.considered, pair.kept, pair.largest) == (6, 5, 5)
    assert pair.contradicting < pair.largest
    assert pair.proven
    assert not pair.ambiguous
    assert [c.live for c in result.closures[:6]] == [True] * 5 + [False]


@pytest.mark.parametrize("settings", EVERY_METHOD, ids=lambda s: f"{s.method}-{s.metric}")
def test_the_sentence_names_the_robots_and_the_count(team_maker, settings):
    team = team_maker(0)
    result = pairwise_consistent(closures_of(team), team.odometry, settings)
    sentences = {(p.robot_a, p.robot_b): p.sentence for p in result.pairs}
    own = sentences.pop(("alpha", "alpha"))
    assert own.startswith("alpha with itself: ")
    (between,) = sentences.values()
    assert between.startswith("alpha and beta: ")
    assert "5 of 6" in between


def test_the_doubt_of_neighbours_names_one_robot_or_two():
    assert "closures within alpha are accepted" in doubt_of_neighbours("alpha", "alpha")
    assert "closures between alpha and beta are accepted" in doubt_of_neighbours("alpha", "beta")


def test_closures_that_contradict_their_neighbours_put_the_result_in_doubt(team_maker):
    """Odometry so vague that both agree with it: but not with each other, side by side."""
    team, rng = team_maker(3, noise=1.0), np.random.default_rng(3)
    shift = np.array([0.0, 0.0, 0.0, 6.0, 0.0, 0.0])
    vague = {name: trajectory.loosened(30.0) for name, trajectory in team.odometry.items()}
    closures = [team.closure(("alpha", n), ("beta", n), noise=rng, error=shift * (n % 3 == 0)) for n in range(1, 59)]
    found = pairwise_consistent(closures, vague, PcmSettings())
    assert found.contradictory == ("alpha", "beta")
    assert doubt_of_neighbours("alpha", "beta") in found.doubts
