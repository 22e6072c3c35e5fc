from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency.incremental import GROWTH, IncrementalConsistency
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.errors import InputError
from wiclosure.types import Closure, KeyframeId, Stage

ENDS = [(3, 50), (17, 31), (28, 8), (41, 57), (55, 22), (10, 44)]


def true(team, ends=ENDS):
    return [team.closure(("alpha", i), ("beta", j)) for i, j in ends]


def taken(team, *batches, settings=None):
    check = IncrementalConsistency(settings or PcmSettings())
    for batch in batches:
        check.add(batch, team.odometry)
    return check


def test_a_first_closure_waits_for_another(team_maker):
    team = team_maker(0)
    first, second = true(team)[:2]
    check = taken(team, [first])
    assert check.inlier_rows == frozenset()
    check.add([second], team.odometry)
    assert check.inlier_rows == {0, 1}


@pytest.mark.parametrize("settings", [PcmSettings(), PcmSettings(method="clique")], ids=["groups", "clique"])
def test_the_answer_is_that_of_all_at_once(team_maker, settings):
    team, rng = team_maker(1), np.random.default_rng(1)
    closures = [*true(team)[:4], team.false_closure(("alpha", 5), ("beta", 5), rng), *true(team)[4:]]
    check = taken(team, *([c] for c in closures), settings=settings)
    at_once = pairwise_consistent(closures, team.odometry, settings)
    assert [c.reason for c in check.result().closures] == [c.reason for c in at_once.closures]
    assert check.inlier_rows == {0, 1, 2, 3, 5, 6}
    assert check.result() is check.result()


def test_between_decisions_new_closures_are_judged_by_prediction(team_maker):
    """Two more than 80 are no reason to decide anew."""
    assert GROWTH * 82 > 2
    team, rng = team_maker(2), np.random.default_rng(2)
    check = taken(team, true(team, rng.integers(0, 60, (80, 2)).tolist()))
    assert check.inlier_rows == set(range(80))
    false = team.false_closure(("alpha", 40), ("beta", 30), rng)
    check.add([*true(team, [(21, 33)]), false], team.odometry)
    assert check.inlier_rows == set(range(81))


def test_without_a_check_all_that_can_be_used_are_inliers(team_maker):
    team, rng = team_maker(3), np.random.default_rng(3)
    broken = team.remeasured(true(team)[0], covariance=np.full((6, 6), np.nan))
    batches = [broken, team.false_closure(("alpha", 5), ("beta", 5), rng)], true(team)[:1]
    check = taken(team, *batches, settings=PcmSettings(enabled=False))
    assert check.inlier_rows == {1, 2}
    check.result()
    assert check.inlier_rows == {1, 2}


def test_closures_that_were_rejected_before_are_no_inliers(team_maker):
    team = team_maker(4)
    gone = true(team)[5].rejected(Stage.REGISTRATION, "too few points")
    check = taken(team, true(team)[:3], [gone])
    assert check.result().closures[3] is gone
    assert check.inlier_rows == {0, 1, 2}


def test_closures_of_unknown_keyframes_are_refused_whole(team_maker):
    team = team_maker(5)
    check = taken(team, true(team)[:3])
    late = Closure.from_measurement(KeyframeId("alpha", 1), KeyframeId("beta", 60), np.eye(4), np.eye(6))
    with pytest.raises(InputError, match="keyframe 60 of beta"):
        check.add([true(team)[3], late], team.odometry)
    assert len(check.result().closures) == 3
