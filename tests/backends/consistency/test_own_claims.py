"""What neighbouring own loops say of each other where odometry says nothing."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise
from wiclosure.backends.consistency.own_claims import OwnClaims
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


def test_neighbours_differ_by_what_the_steps_of_odometry_between_their_ends_explain(team_maker):
    of, _, _ = claims_of(team_maker, 7, 5)
    one, other = np.divmod(np.arange(65 * 65), 65)
    one, other = one[one < other], other[one < other]
    steps, rng, samples = of.robots.odometry, np.random.default_rng(0), 3000
    errors = np.zeros((len(of.robots.robot), 6, samples))
    L = se3.adjoint(of.robots.poses[steps.second]) @ np.linalg.cholesky(steps.covariance)
    errors[steps.second] = L @ rng.normal(size=(len(steps), 6, samples))
    wander = np.cumsum(errors, axis=0)
    frames = se3.adjoint(se3.inverse(of.frames)) @ wander[of.first] - wander[of.second]
    noise, sampled = np.linalg.cholesky(of.noise), []
    frames += noise @ rng.normal(size=(len(of), 6, samples))
    for a, b in zip(one, other, strict=True):
        apart = se3.log(se3.between(of.frames[a], of.frames[b])[None])[0]
        sampled.append(apart @ np.linalg.solve(np.cov(frames[b] - frames[a]), apart))
    np.testing.assert_allclose(of.pair_distances(one, other), sampled, rtol=0.2)
    from_odometry = [e @ np.linalg.solve(np.cov(f), e) for e, f in zip(se3.log(of.frames), frames, strict=True)]
    np.testing.assert_allclose(of.distances, from_odometry, rtol=0.2)
