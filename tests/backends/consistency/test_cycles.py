from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise
from wiclosure.backends.consistency.cycles import Cycles
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.drift import DriftModel
from wiclosure.types import Trajectory

EXACT = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
SEEDS = st.integers(0, 2**32 - 1)


def cycles_of(closures, odometry):
    (closure_set,), _ = closure_sets(closures, odometry, EXACT)
    return Cycles.of(closure_set, odometry)


def all_squared(cycles):
    everyone = np.arange(len(cycles.closure_set))
    return np.stack([cycles.mahalanobis_squared(row, everyone) for row in everyone])


@settings(max_examples=50, deadline=None)
@given(seed=SEEDS, spread_m=st.sampled_from([0.1, 10.0, 1000.0]))
def test_perfect_closures_in_any_geometry_leave_no_residual(team_maker, seed, spread_m):
    """Robots that jump about at random, turned every way, in odometry frames anywhere."""
    rng = np.random.default_rng(seed)
    team = team_maker(seed)
    xi = rng.normal(size=(2, 60, 6)) * np.repeat([2.0, spread_m], 3)
    poses, frames = se3.exp(xi), se3.exp(rng.normal(size=(2, 6)) * np.repeat([2.0, spread_m], 3))
    stamps = np.arange(60, dtype=np.int64) * 10**9
    truth = {r: Trajectory(r, stamps, T) for r, T in zip(team.truth, poses, strict=True)}
    odometry = {r: truth[r].moved(T) for r, T in zip(truth, frames, strict=True)}
    cycles = cycles_of(replace(team, truth=truth).random_closures(10, rng), odometry)
    for row in range(10):
        assert np.abs(se3.log(cycles.closing_transforms(row, np.arange(10)))).max() <= 1e-9


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_distances_do_not_depend_on_the_odometry_frames(team_maker, seed):
    team, rng = team_maker(seed, noise=1.0), np.random.default_rng(seed)
    closures = team.random_closures(10, rng, noise=rng)
    moved = {r: t.moved(se3.from_yaw(rng.uniform(-3, 3), rng.normal(size=3) * 100.0)) for r, t in team.odometry.items()}
    here, there = (all_squared(cycles_of(closures, odometry)) for odometry in (team.odometry, moved))
    np.testing.assert_allclose(here, there, rtol=1e-5, atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS, bias=st.sampled_from([0.0, 0.001]))
def test_sigma_is_the_four_covariances_composed_along_the_cycle(team_maker, seed, bias):
    team, rng = team_maker(seed), np.random.default_rng(seed)
    drift = DriftModel(rotation_bias=bias, translation_bias=10 * bias)
    odometry = {r: replace(t, drift=drift) for r, t in team.odometry.items()}
    cycles = cycles_of([team.closure(("alpha", 5), ("beta", 40)), team.closure(("alpha", 50), ("beta", 9))], odometry)
    closure_set, (i, j), (k, m) = (
        cycles.closure_set,
        cycles.closure_set.index_a[:, None],
        cycles.closure_set.index_b[:, None],
    )
    a, b = odometry[closure_set.robot_a], odometry[closure_set.robot_b]
    x_ij, x_lk = a.relative_pose(i, j), b.relative_pose(m, k)
    sigma = se3.inverse_covariance(closure_set.T_a_b[:1], closure_set.covariance[:1])
    sigma = se3.compose_covariance(sigma, x_ij, a.relative_covariance(i, j))
    sigma = se3.compose_covariance(sigma, closure_set.T_a_b[1:], closure_set.covariance[1:])
    sigma = se3.compose_covariance(sigma, x_lk, b.relative_covariance(m, k))
    off = rng.normal(size=6) * np.repeat([1e-5, 1e-4], 3)  # the cycle is off by this: little, for the first order
    spoiled = replace(closure_set, T_a_b=np.stack([closure_set.T_a_b[0] @ se3.exp(-off), closure_set.T_a_b[1]]))
    found = replace(cycles, closure_set=spoiled).mahalanobis_squared(0, np.array([1]))
    np.testing.assert_allclose(found, mahalanobis_squared(off[None], sigma), rtol=0.002)


def test_noisy_closures_have_the_variance_that_sigma_promises(team_maker):
    squared = []
    for seed in range(200):
        team, rng = team_maker(seed, noise=1.0), np.random.default_rng(seed)
        cycles = cycles_of(team.random_closures(2, rng, noise=rng), team.odometry)
        squared.append(cycles.mahalanobis_squared(1, np.array([0]))[0])
    # The mean of chi-square with 6 degrees of freedom is 6, that of 200 draws within 0.25 of it (one sigma).
    assert 5.2 < np.mean(squared) < 6.8


@settings(max_examples=20, deadline=None)
@given(seed=SEEDS)
def test_the_limit_leaves_out_only_what_exceeds_it(team_maker, seed):
    team, rng = team_maker(seed, noise=1.0), np.random.default_rng(seed)
    false = [team.false_closure(("alpha", int(a)), ("beta", int(b)), rng) for a, b in rng.integers(0, 60, (6, 2))]
    cycles = cycles_of(team.random_closures(6, rng, noise=rng) + false, team.odometry)
    everyone = np.arange(12)
    for row in everyone:
        full, limited = (cycles.mahalanobis_squared(row, everyone, limit=limit) for limit in (np.inf, 20.0))
        np.testing.assert_allclose(limited[full < 20.0], full[full < 20.0])
        assert (limited[full >= 20.0] >= 20.0).all()


def test_the_legacy_cycle_is_zero_only_for_transforms_that_are_their_own_inverse(team_maker):
    team = team_maker(10)
    there_and_back = [team.closure(("alpha", i), ("beta", i)) for i in range(0, 60, 10)]
    line = se3.from_yaw(0.0, np.arange(60.0)[:, None] * [1.0, 0.0, 0.0])
    opposite = se3.from_yaw(np.pi, line[:, :3, 3])
    stamps = np.arange(60, dtype=np.int64) * 10**9
    odometry = {"alpha": Trajectory("alpha", stamps, line), "beta": Trajectory("beta", stamps, opposite)}
    closures = [
        team.remeasured(c, T_query_match=se3.between(line[i * 10], opposite[i * 10]))
        for i, c in enumerate(there_and_back)
    ]
    own_inverse, general = cycles_of(closures, odometry), cycles_of(there_and_back, team.odometry)
    others = np.arange(1, 6)
    assert np.abs(se3.log(own_inverse.legacy_transforms(0, others))).max() < 1e-9
    assert np.linalg.norm(se3.log(general.legacy_transforms(0, others)), axis=1).min() > 1.0
    assert np.abs(se3.log(general.closing_transforms(0, others))).max() < 1e-9
