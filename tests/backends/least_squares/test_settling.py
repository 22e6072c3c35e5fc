from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.factor_graph.truncated_least_squares import truncated_cost
from wiclosure.backends.least_squares import graduated as graduated_module
from wiclosure.backends.least_squares.edges import Edges
from wiclosure.backends.least_squares.graduated import graduated
from wiclosure.backends.least_squares.settling import (
    Settled,
    fewest_errors,
    outlier_limit,
    settle,
)
from wiclosure.backends.least_squares.system import System
from wiclosure.backends.least_squares.variance_components import VarianceComponents

SIGMA = np.repeat([0.01, 0.05], 3)
NODES = 30
HELD = np.array([0])
LIMIT = outlier_limit(12, 0.99)


def path(seed, noise=1.0):
    """Odometry of one robot, 12 true loops, the poses as odometry has them, and the true ones."""
    rng = np.random.default_rng(seed)
    angle = 4 * np.pi * np.arange(NODES) / NODES  # twice around a ring
    truth = se3.from_yaw(angle, np.stack([8 * np.sin(angle), 8 - 8 * np.cos(angle), 0 * angle], axis=1))
    first = rng.integers(0, NODES - 5, 12)
    second = first + 3 + rng.integers(0, NODES - 4 - first)
    odometry = measured(truth, np.arange(NODES - 1), np.arange(1, NODES), rng, noise)
    loops = measured(truth, first, second, rng, noise)
    poses = [np.eye(4)]
    for step in odometry.T:
        poses.append(poses[-1] @ step)
    return odometry, loops, np.stack(poses), truth


def measured(truth, first, second, rng, noise):
    T = se3.between(truth[first], truth[second]) @ se3.exp(noise * rng.normal(size=(len(first), 6)) * SIGMA)
    return Edges(first, second, T, np.tile(np.diag(SIGMA**2), (len(first), 1, 1)))


def spoiled(loops, rows):
    T = loops.T.copy()
    T[rows] = T[rows] @ se3.from_yaw(0.6, np.array([3.0, -2.0, 0.0]))
    return Edges(loops.first, loops.second, T, loops.covariance)


def settled(odometry, loops, poses, inlier=None, inside=None):
    every = np.ones(len(loops), bool)
    inlier, inside = every if inlier is None else inlier, every if inside is None else inside
    return settle(odometry, loops, inlier, inside, poses, HELD, LIMIT)


def assert_same(poses, truth, atol):
    np.testing.assert_allclose(poses, se3.between(truth[0], truth), atol=atol)


@pytest.mark.parametrize("seed", range(3))
def test_perfect_loops_are_accepted_and_the_answer_is_exact(seed):
    odometry, loops, poses, truth = path(seed, noise=0.0)
    found = settled(odometry, loops, poses)
    assert found.inlier.all()
    np.testing.assert_allclose(found.distance, 0.0, atol=1e-6)
    assert_same(found.poses, truth, 1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_loops_that_the_others_contradict_are_refused_though_taken_at_first(seed):
    odometry, loops, poses, _ = path(seed)
    found = settled(odometry, spoiled(loops, [2, 7]), poses)
    assert np.flatnonzero(~found.inlier).tolist() == [2, 7]
    assert (found.distance[[2, 7]] > LIMIT).all()


def test_loops_that_the_others_predict_are_admitted():
    odometry, loops, poses, _ = path(0)
    assert settled(odometry, loops, poses, inlier=np.arange(12) % 2 == 0).inlier.all()


def test_loops_between_groups_are_not_judged():
    odometry, loops, poses, _ = path(1)
    inside = np.arange(12) != 4
    found = settled(odometry, spoiled(loops, [4]), poses, inside=inside)
    assert found.inlier.tolist() == inside.tolist()
    assert np.isnan(found.distance).tolist() == (~inside).tolist()


def test_where_the_frame_lies_changes_no_decision():
    odometry, loops, poses, _ = path(2)
    moved = se3.from_yaw(1.0, np.array([50.0, -20.0, 3.0]))
    here, there = (settled(odometry, spoiled(loops, [5]), T @ poses) for T in (np.eye(4), moved))
    assert here.inlier.tolist() == there.inlier.tolist()
    np.testing.assert_allclose(there.poses, moved @ here.poses, atol=1e-6)
    np.testing.assert_allclose(there.distance, here.distance, rtol=1e-3)


def test_the_held_node_does_not_wander_and_the_spread_grows_along_odometry():
    odometry, loops, poses, _ = path(0)
    found = settled(odometry, loops, poses, inlier=np.zeros(12, bool), inside=np.zeros(12, bool))
    spread = found.wander.std(axis=2)
    np.testing.assert_allclose(spread[0], 0.0, atol=1e-5)
    assert found.wander.shape[:2] == (NODES, 6)
    assert spread[1, 2] == pytest.approx(SIGMA[2], rel=0.3)
    assert spread[-1, 2] == pytest.approx(SIGMA[2] * np.sqrt(NODES - 1), rel=0.3)


def test_a_scale_of_sigma_divides_distances_by_its_square():
    components = VarianceComponents(np.array([4.0, 8.0]), np.array([1.0, 2.0]))
    distances = np.array([8.0]), np.array([4.0, 12.0])
    one = Settled(np.eye(4)[None], np.ones((1, 6, 3)), np.ones(1, bool), *distances, components=components)
    two = one.scaled(2.0)
    assert (two.distance.tolist(), two.redundant.tolist()) == ([2.0], [1.0, 3.0])
    assert (two.components.squared.tolist(), two.components.redundancy.tolist()) == ([1.0, 2.0], [1.0, 2.0])
    np.testing.assert_array_equal(two.wander, 2.0)
    np.testing.assert_array_equal(two.poses, one.poses)


def among(odometry, loops, poses):
    """`graduated` from the poses."""
    return graduated(System.of(odometry + loops, poses, HELD), len(odometry), [poses], LIMIT)


def test_gnc_finds_the_inliers_from_odometry_alone():
    odometry, loops, poses, truth = path(3)
    wrong = [0, 3, 4, 8, 11]
    inlier, found = among(odometry, spoiled(loops, wrong), poses)
    assert np.flatnonzero(~inlier).tolist() == wrong
    assert_same(found, truth, 0.3)


@pytest.mark.parametrize("seed", range(3))
def test_gnc_takes_no_more_steps_than_mu_needs_to_leave_none_undecided(monkeypatch, seed):
    """From where the worst residual is as likely an inlier as not, to mu = 1: from twice the limit on, no weight."""
    odometry, loops, poses, _ = path(seed)
    bad, steps, weights = spoiled(loops, [0, 3, 4, 8, 11]), [], graduated_module.truncated_weights

    def counted(chi_square, limit, mu):
        steps.append((mu, chi_square))
        return weights(chi_square, limit, mu)

    monkeypatch.setattr(graduated_module, "truncated_weights", counted)
    inlier, _ = among(odometry, bad, poses)
    (first_mu, plain), (_, last), taken = steps[0], steps[-1], len(steps) - 1
    assert first_mu == pytest.approx(LIMIT / (2 * plain.max() - LIMIT))
    assert last[~inlier].min() > 2 * LIMIT
    assert 2 <= taken <= 1 + np.ceil(-np.log(first_mu) / np.log(graduated_module.MU_GROWTH))


def test_gnc_keeps_all_where_the_plain_answer_fits():
    odometry, loops, poses, truth = path(4, noise=0.0)
    inlier, found = among(odometry, loops, poses)
    assert inlier.all()
    assert_same(found, truth, 1e-6)


def test_the_limit_is_above_chi_square_and_grows_with_the_closures():
    """Covariances are sampled, which makes tails heavier; by a few per cent only."""
    limits = [outlier_limit(n, 0.99) for n in (1, 10, 1000)]
    exact = [chi2.ppf(0.99 ** (1.0 / n), 6) for n in (1, 10, 1000)]
    assert limits == sorted(limits)
    assert all(x < limit < 1.6 * x for limit, x in zip(limits, exact, strict=True))
    assert outlier_limit(0, 0.99) == limits[0]


def test_the_cost_of_known_edges_is_whole_and_of_others_no_more_than_the_limit():
    assert truncated_cost(np.array([30.0, 1.0, 2.0, 50.0]), 2, 10.0) == 43.0


def test_the_limit_is_the_lower_the_denser_outliers_lie():
    assert fewest_errors(100, np.zeros(0), 35.0) == 35.0
    far, near = (fewest_errors(100, np.full(5, distance), 35.0) for distance in (1e6, 45.0))
    assert far > 0.95 * 35.0
    assert chi2.ppf(0.95, 6) < near < 0.8 * 35.0


def test_the_limit_makes_the_fewest_errors_of_closures_as_drawn():
    """True ones by chi-square, false ones as dense everywhere: no other limit does clearly better."""
    rng = np.random.default_rng(0)
    true, false = rng.chisquare(6, 2000), 400.0 * rng.random(100_000) ** (1 / 3)
    limit = 45.0
    bound = fewest_errors(int((true <= limit).sum()), false[false > limit], limit)

    def errors(at):
        return (true > at).sum() + (false <= at).sum()

    assert errors(bound) <= 1.5 * min(errors(at) for at in np.linspace(5.0, 45.0, 81))
    assert errors(bound) < 0.5 * errors(limit)


def test_what_the_others_predict_is_an_inlier_even_where_rounds_end_early():
    """Outliers of very different sizes are dropped one round after another, before anything is admitted."""
    poses = se3.from_yaw(np.zeros(9), np.arange(9.0)[:, None] * [1.0, 0.0, 0.0])
    steps = Edges(
        np.arange(8), np.arange(1, 9), se3.between(poses[:-1], poses[1:]), np.tile(1e-6 * np.eye(6), (8, 1, 1))
    )
    first, second = np.zeros(6, np.int64), np.arange(3, 9)
    T = se3.between(poses[first], poses[second])
    T[1:, 1, 3] += 10.0 * 3.0 ** np.arange(5)
    loops = Edges(first, second, T, np.tile(np.eye(6), (6, 1, 1)))
    inlier, everyone = np.arange(6) > 0, np.ones(6, bool)
    for rounds in (3, 12):
        found = settle(steps, loops, inlier, everyone, poses, np.array([0]), 40.0, rounds)
        assert found.inlier.tolist() == [True] + [False] * 5


@pytest.mark.parametrize("seed", range(5))
def test_the_strain_of_a_step_is_by_how_much_leaving_it_out_lowers_the_cost(seed):
    odometry, loops, poses, _ = path(seed)
    bent = odometry.T.copy()
    bent[14] = bent[14] @ se3.from_yaw(0.05, np.array([0.3, -0.2, 0.0]))
    odometry = Edges(odometry.first, odometry.second, bent, odometry.covariance)
    found = settle(odometry, loops, np.ones(12, bool), np.ones(12, bool), poses, HELD, np.inf)

    def least_cost(rows):
        edges = odometry.subset(rows) + loops
        system = System.of(edges, found.poses, HELD)
        return system.cost(system.solved(found.poses))

    every = np.ones(NODES - 1, bool)
    drops = [least_cost(every) - least_cost(every & (np.arange(NODES - 1) != k)) for k in (10, 14, 18)]
    assert found.strain.shape == (NODES - 1,)
    assert found.strain[[10, 14, 18]] == pytest.approx(drops, rel=0.5)  # the covariance is sampled


def flattened(edges):
    """The same measurements without roll, pitch and height."""
    xi = se3.log(edges.T)
    xi[:, [0, 1, 5]] = 0.0
    return Edges(edges.first, edges.second, se3.exp(xi), edges.covariance)


@pytest.mark.parametrize("seed", range(3))
def test_a_loop_that_leaves_the_plane_is_judged_without_giving_the_others_six_unknowns(seed):
    odometry, loops, _, _ = path(seed)
    odometry, loops = flattened(odometry), flattened(loops)
    poses = [np.eye(4)]
    for step in odometry.T:
        poses.append(poses[-1] @ step)
    start, kept = np.stack(poses), np.arange(12) != 4
    alone = settled(odometry, loops.subset(kept), start)
    lifted = Edges(loops.first, loops.second, loops.T.copy(), loops.covariance)
    lifted.T[4, 2, 3] += 0.5  # ten sigma
    found = settled(odometry, lifted, start, inlier=kept)
    assert found.inlier.tolist() == kept.tolist()
    assert 80 < found.distance[4] < 120
    np.testing.assert_allclose(found.poses, alone.poses, atol=1e-6)
    assert not found.wander[:, [0, 1, 5]].any()
    np.testing.assert_allclose(found.distance[kept], alone.distance, rtol=0.6, atol=1.0)  # by other samples


def test_a_loop_that_leaves_the_plane_within_its_noise_is_admitted():
    odometry, loops, _, truth = path(1)
    odometry, loops = flattened(odometry), flattened(loops)
    start, kept = se3.between(truth[0], truth), np.arange(12) != 4
    lifted = Edges(loops.first, loops.second, loops.T.copy(), loops.covariance)
    lifted.T[4, 2, 3] += 0.05  # one sigma
    found = settled(odometry, lifted, start, inlier=kept)
    assert found.inlier.all()
    assert found.wander[:, 5].any()  # the height is unknown now
