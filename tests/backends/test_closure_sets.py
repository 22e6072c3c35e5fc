from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.closure_sets import Decision, canonical_order, closure_sets, decided
from wiclosure.backends.config import ClosureNoise
from wiclosure.errors import InputError
from wiclosure.types import Closure, KeyframeId, Stage

NOISE = ClosureNoise(translation_m=0.2, rotation_rad=0.03)


def turned(closure):
    T, covariance = closure.measured.T_query_match, closure.measured.covariance
    return Closure.from_measurement(closure.match, closure.query, se3.inverse(T), se3.inverse_covariance(T, covariance))


def between_true(team, closure_set):
    return se3.between(
        team.truth[closure_set.robot_a].poses[closure_set.index_a],
        team.truth[closure_set.robot_b].poses[closure_set.index_b],
    )


@settings(max_examples=10)
@given(seed=st.integers(0, 10**6))
def test_sets_run_in_one_direction_whichever_way_closures_do(team_maker, seed):
    team, rng = team_maker(seed), np.random.default_rng(seed)
    closures = [team.closure(("alpha", int(i)), ("beta", int(j))) for i, j in rng.integers(0, 60, (6, 2))]
    mixed = [turned(c) if n % 2 else c for n, c in enumerate(closures)]
    (closure_set,), unusable = closure_sets(mixed, team.odometry, NOISE)
    assert not unusable
    assert closure_set.rows.tolist() == list(range(6))
    assert closure_set.between_robots
    np.testing.assert_allclose(closure_set.T_a_b, between_true(team, closure_set), atol=1e-9)


def test_the_noise_floor_is_added_to_what_is_stated(team_maker):
    team = team_maker(0)
    first, second = canonical_order(team.odometry)
    (closure_set,), _ = closure_sets([team.closure((first, 3), (second, 4))], team.odometry, NOISE)
    np.testing.assert_allclose(
        closure_set.covariance[0], np.diag([0.01**2 + 0.03**2] * 3 + [0.1**2 + 0.2**2] * 3), rtol=1e-12
    )


def test_closures_within_a_robot_run_from_early_to_late(team_maker):
    team = team_maker(1)
    (closure_set,), _ = closure_sets(
        [team.closure(("alpha", 40), ("alpha", 5)), team.closure(("alpha", 7), ("alpha", 30))], team.odometry, NOISE
    )
    assert (closure_set.index_a.tolist(), closure_set.index_b.tolist()) == ([5, 7], [40, 30])
    assert not closure_set.between_robots
    assert closure_set.name == "alpha with itself"
    np.testing.assert_allclose(closure_set.T_a_b, between_true(team, closure_set), atol=1e-9)


def test_each_pair_of_robots_has_a_set_with_the_rows_of_its_closures(team_maker):
    team = team_maker(2, ("alpha", "beta", "gamma"))
    ends = [("alpha", "beta"), ("gamma", "alpha"), ("beta", "alpha"), ("beta", "gamma")]
    closures = [team.closure((a, 3 * n), (b, 50 - n)) for n, (a, b) in enumerate(ends)]
    closures.append(team.closure(("alpha", 1), ("beta", 2)).rejected(Stage.REGISTRATION, "too few points"))
    sets, _ = closure_sets(closures, team.odometry, NOISE)
    assert {closure_set.name: closure_set.rows.tolist() for closure_set in sets} == {
        "alpha and beta": [0, 2],
        "alpha and gamma": [1],
        "beta and gamma": [3],
    }
    closure_set = sets[[len(closure_set) for closure_set in sets].index(2)].subset(np.array([False, True]))
    assert (closure_set.rows.tolist(), len(closure_set), closure_set.T_a_b.shape) == ([2], 1, (1, 4, 4))


def test_names_do_not_change_the_order_of_robots(team_maker):
    team = team_maker(3, ("alpha", "beta", "gamma"))
    renamed = dict(zip(("z", "y", "x"), team.odometry.values(), strict=True))
    back = dict(zip(renamed, team.odometry, strict=True))
    assert [back[robot] for robot in canonical_order(dict(reversed(renamed.items())))] == canonical_order(team.odometry)
    elsewhere = {r: t.moved(se3.from_yaw(1.0, np.array([9.0, 2.0, 0.0]))) for r, t in team.odometry.items()}
    assert canonical_order(elsewhere) == canonical_order(team.odometry)


def test_measurements_that_cannot_be_used_are_told_why(team_maker):
    team = team_maker(4)
    good, gone = team.closure(("alpha", 1), ("beta", 2)), np.full((6, 6), np.nan)
    no_pose = good.measured.T_query_match.copy()
    no_pose[0, 3] = np.inf
    closures = [
        good,
        team.remeasured(good, T_query_match=no_pose),
        team.remeasured(good, covariance=gone),
        team.remeasured(good, covariance=-np.eye(6)),
        Closure.from_measurement(KeyframeId("alpha", 5), KeyframeId("alpha", 5), np.eye(4), np.eye(6)),
    ]
    (closure_set,), unusable = closure_sets(closures, team.odometry, NOISE)
    assert closure_set.rows.tolist() == [0]
    assert unusable == {
        1: "its transform is not finite",
        2: "its covariance is not finite",
        3: "its covariance is not positive",
        4: "closes a keyframe on itself",
    }


def test_unknown_robots_and_keyframes_are_named(team_maker):
    team = team_maker(5)
    closure = Closure.from_measurement(KeyframeId("alpha", 3), KeyframeId("nobody", 0), np.eye(4), np.eye(6))
    with pytest.raises(InputError, match="unknown robot 'nobody'; trajectories are given for alpha, beta"):
        closure_sets([closure], team.odometry, NOISE)
    closure = Closure.from_measurement(KeyframeId("alpha", 3), KeyframeId("beta", 60), np.eye(4), np.eye(6))
    with pytest.raises(InputError, match="keyframe 60 of beta, which has 60 keyframes"):
        closure_sets([closure], team.odometry, NOISE)


def test_verdicts_reach_their_rows_and_no_others(team_maker):
    team = team_maker(6)
    closures = [team.closure(("alpha", n), ("beta", n)) for n in range(3)]
    result = decided(closures, Stage.CONSISTENCY, {2: Decision(False, "off"), 0: Decision(True, "fits")})
    assert [c.live for c in result] == [True, True, False]
    assert [c.survived(Stage.CONSISTENCY) for c in result] == [True, False, False]
    assert (result[0].reason, result[2].reason) == ("fits", "off")
    assert result[1] is closures[1]
