"""What neighbouring own loops say of each other where odometry says nothing."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise
from wiclosure.backends.consistency.own_claims import OwnClaims
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.settling import outlier_limit
from wiclosure.backends.least_squares.team_arrays import TeamArrays

STATED = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
PROBABILITY, WORSE = 0.99, 5.0  # than stated, the odometry


def claims_of(team_maker, seed, false):
    """Of a robot whose odometry is taken as loose as it is, 60 true loops and false ones; and a limit for them."""
    team, rng = team_maker(seed, ("alpha",), noise=WORSE), np.random.default_rng(seed)
    ends = rng.integers([0, 35], [25, 60], (60 + false, 2)).tolist()
    closures = [team.closure(("alpha", i), ("alpha", j), noise=rng) for i, j in ends[:60]]
    closures += [team.false_closure(("alpha", i), ("alpha", j), rng) for i, j in ends[60:]]
    odometry = {"alpha": team.odometry["alpha"].loosened(WORSE)}
    sets, _ = closure_sets(closures, odometry, STATED)
    robots = TeamArrays.of(odometry, sets, np.zeros(len(closures), bool)).robots
    return OwnClaims.of(robots), outlier_limit(len(closures), PROBABILITY, robots.degrees), robots.degrees


@pytest.mark.parametrize("seed", range(5))
def test_true_loops_do_not_contradict_each_other(team_maker, seed):
    of, limit, degrees = claims_of(team_maker, seed, 0)
    assert not of.contradictory(limit, PROBABILITY, degrees)


@pytest.mark.parametrize("seed", range(5))
def test_false_ones_contradict_their_neighbours_where_odometry_refutes_nothing(team_maker, seed):
    of, _, degrees = claims_of(team_maker, seed, 60)
    assert of.contradictory(np.inf, PROBABILITY, degrees)
    assert not of.refuted(np.inf).any()


def test_what_odometry_says_is_as_uncertain_as_its_samples_say(team_maker):
    of, _, _ = claims_of(team_maker, 7, 5)
    sampled = mahalanobis_squared(se3.log(of.claims.frames), of.claims.frame_covariance)
    np.testing.assert_allclose(of.distances, sampled, rtol=0.8)  # of a hundred samples
    assert 0.85 < np.median(of.distances / sampled) < 1.15
