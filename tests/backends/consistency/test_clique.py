from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise, PcmSettings
from wiclosure.backends.consistency.clique import chi_square_limit, consistency_matrix, largest_clique

STATED = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
SETTINGS = PcmSettings(noise=STATED)


def noisy(team, n, n_false, seed):
    rng = np.random.default_rng(seed)
    ends = [tuple(map(int, pair)) for pair in rng.integers(0, 60, (n + n_false, 2))]
    closures = [team.closure(("alpha", i), ("beta", j), noise=rng) for i, j in ends[:n]]
    closures += [team.false_closure(("alpha", i), ("beta", j), rng) for i, j in ends[n:]]
    (closure_set,), _ = closure_sets(closures, team.odometry, STATED)
    return closure_set


def test_the_limit_is_the_quantile_of_chi_square():
    assert chi_square_limit(0.99) == pytest.approx(16.81, abs=0.01)  # six degrees of freedom, from the tables


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_the_largest_set_is_that_of_trying_all_sets(team_maker, seed):
    team = team_maker(seed, noise=1.0)
    closure_set = noisy(team, 5, 6, seed)
    consistent = consistency_matrix(closure_set, team.odometry, SETTINGS)
    assert (consistent == consistent.T).all()
    assert not consistent.diagonal().any()
    largest = max(
        size
        for size in range(1, len(closure_set) + 1)
        if any(
            consistent[np.ix_(s, s)].sum() == size * (size - 1)
            for s in map(list, combinations(range(len(closure_set)), size))
        )
    )
    report, _ = largest_clique(closure_set, team.odometry, SETTINGS)
    assert report.largest == largest


def test_true_closures_are_kept_and_false_ones_refused_with_the_reason(team_maker):
    team = team_maker(7, noise=1.0)
    report, decisions = largest_clique(
        noisy(team, 12, 8, 7), team.odometry, PcmSettings(noise=STATED, probability=0.999)
    )
    assert [decisions[row].accepted for row in range(20)] == [True] * 12 + [False] * 8
    assert decisions[0].reason == "one of 12 closures that agree"
    assert decisions[15].reason.startswith(
        "inconsistent with the 12 closures of the largest consistent set (agrees with "
    )
    assert report.kept == 12
    assert "12 of 20 closures agree and are accepted" in report.sentence


@pytest.mark.parametrize(
    ("n", "settings_", "says"),
    [
        (1, {}, "a single closure cannot be checked"),
        (3, {"min_clique_size": 5}, "no more than 3 of the 3 closures agree, 5 must"),
        (3, {"start_threshold": 10}, "3 closures are fewer than the 10 that pcm.start_threshold asks for"),
    ],
)
def test_sets_that_are_too_small_are_refused(team_maker, n, settings_, says):
    team = team_maker(1)
    closure_set = noisy(team, n, 0, 1)
    report, decisions = largest_clique(
        closure_set, team.odometry, PcmSettings(noise=STATED, probability=0.9999, **settings_)
    )
    assert not any(decision.accepted for decision in decisions.values())
    assert says in report.sentence


@pytest.mark.parametrize("metric", ["mahalanobis", "unit"])
def test_closures_within_one_robot_are_held_against_its_own_odometry(team_maker, metric):
    team = team_maker(2)
    rng = np.random.default_rng(0)
    closures = [team.closure(("alpha", k), ("alpha", k + 30)) for k in range(4)]
    closures.append(team.false_closure(("alpha", 2), ("alpha", 50), rng))
    (closure_set,), _ = closure_sets(closures, team.odometry, STATED)
    _, decisions = largest_clique(closure_set, team.odometry, PcmSettings(noise=STATED, metric=metric))
    assert [decisions[row].accepted for row in range(5)] == [True] * 4 + [False]
    assert decisions[4].reason == "contradicts the robot's own odometry"
