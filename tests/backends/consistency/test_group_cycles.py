from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.consistency.group_cycles import settle_cycles
from wiclosure.backends.sets.alignment import ClosureComparison
from wiclosure.backends.sets.candidate_sets import CandidateSet
from wiclosure.backends.sets.claims import Claims

SIGMA = np.repeat([0.01, 0.1], 3)
LIMIT = float(chi2.ppf(0.99, 6))
CLEARLY = 0.8
SHIFT = se3.from_yaw(0.4, np.array([20.0, 5.0, 0.0]))


class Groups:
    """Three groups, each in its own frame, and sets of closures between them."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.frames = se3.from_yaw(self.rng.uniform(-3, 3, 3), self.rng.normal(0, 20, (3, 3)))
        self.poses = [se3.from_yaw(self.rng.uniform(-3, 3, 60), self.rng.normal(0, 20, (60, 3))) for _ in range(3)]
        self.places = {g: (self.poses[g], np.zeros((60, 6, 100))) for g in range(3)}

    def candidate(self, a, b, size, *, shift=None, objection=""):
        """A set of `size` closures with small errors; as if b lay elsewhere by `shift`."""
        T_a_b = se3.between(self.frames[a], self.frames[b]) @ (np.eye(4) if shift is None else shift)
        T_a, T_b = (self.poses[g][self.rng.integers(0, 60, size)] for g in (a, b))
        T = se3.between(T_a, T_a_b @ T_b) @ se3.exp(0.2 * self.rng.normal(size=(size, 6)) * SIGMA)
        still = np.zeros((size, 6, 100))
        claims = Claims(T_a, T_b, T, np.tile(np.diag(SIGMA**2), (size, 1, 1)), still, still)
        comparison = ClosureComparison.of(claims, LIMIT)
        closure_set = comparison.consistent_sets(LIMIT)[0]
        assert len(closure_set) == size
        return CandidateSet(a, b, np.arange(size), closure_set, comparison, objection=objection)

    def settled(self, *candidates):
        settle_cycles(candidates, self.places, LIMIT, CLEARLY)
        return [candidate.holds for candidate in candidates]


@pytest.fixture(params=range(3))
def groups(request):
    return Groups(request.param)


def test_three_sets_that_close_a_cycle_hold_and_support_each_other(groups):
    sets = [groups.candidate(a, b, 5) for a, b in ((0, 1), (1, 2), (0, 2))]
    assert groups.settled(*sets) == [True] * 3
    assert all(c.support > 0 and c.contradiction == 0 for c in sets)


def test_a_doubtful_set_that_a_cycle_closes_holds(groups):
    doubtful = groups.candidate(0, 1, 2, objection="a single place")
    assert not doubtful.holds
    assert groups.settled(doubtful, groups.candidate(1, 2, 5), groups.candidate(0, 2, 5)) == [True] * 3


def test_a_doubtful_set_that_closes_no_cycle_does_not_hold(groups):
    doubtful = groups.candidate(0, 1, 2, objection="a single place", shift=SHIFT)
    assert groups.settled(doubtful, groups.candidate(1, 2, 5), groups.candidate(0, 2, 5)) == [False, True, True]


def test_of_three_alike_that_contradict_each_other_none_holds(groups):
    sets = [groups.candidate(0, 1, 5, shift=SHIFT), groups.candidate(1, 2, 5), groups.candidate(0, 2, 5)]
    assert groups.settled(*sets) == [False] * 3
    assert all(c.refutation for c in sets)


@pytest.mark.parametrize(("size", "falls"), [(5, [True] * 3), (12, [True, False, False])])
def test_a_set_falls_alone_if_a_right_one_of_its_size_would_hardly_span_as_little(groups, size, falls):
    sets = [groups.candidate(0, 1, size, shift=SHIFT), groups.candidate(1, 2, 20), groups.candidate(0, 2, 20)]
    sets[0].coverage = 0.5
    groups.settled(*sets)
    assert [bool(c.refutation) for c in sets] == falls


def test_of_two_rivals_the_one_that_closes_the_cycle_holds(groups):
    true, false = (groups.candidate(0, 1, 5, shift=moved, objection="ambiguous") for moved in (None, SHIFT))
    assert groups.settled(false, true, groups.candidate(1, 2, 5), groups.candidate(0, 2, 5)) == [
        False,
        True,
        True,
        True,
    ]


def test_sets_without_a_cycle_stay_as_they_are(groups):
    assert groups.settled(groups.candidate(0, 1, 5), groups.candidate(1, 2, 2, objection="chance")) == [True, False]
    groups.settled()


def test_the_frame_is_where_the_second_group_lies_in_the_first(groups):
    candidate = groups.candidate(0, 2, 6)
    apart = se3.log(se3.between(candidate.frame, se3.between(groups.frames[0], groups.frames[2])))
    assert apart @ np.linalg.solve(candidate.noise, apart) < LIMIT
    assert len(candidate) == 6
    assert candidate.wander.shape == (6, 100)


def test_more_closures_and_more_places_weigh_more(groups):
    few, many = groups.candidate(0, 1, 2), groups.candidate(0, 1, 5)
    assert few.weight < many.weight
    many.coverage = 0.3
    assert many.weight < groups.candidate(0, 1, 5).weight
