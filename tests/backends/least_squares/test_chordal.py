from __future__ import annotations

import gtsam
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.backends.least_squares.chordal import cheaper_start, chordal
from wiclosure.backends.least_squares.edges import Edges
from wiclosure.backends.least_squares.system import System

SIGMA = np.repeat([0.05, 0.2], 3)


def cluttered(seed, noise, n=30, chords=40):
    """Poses anywhere, a path through them and chords at random, with noise; true poses."""
    rng = np.random.default_rng(seed)
    truth = se3.exp(rng.normal(size=(n, 6)) * np.repeat([1.5, 5.0], 3))
    ends = np.concatenate([np.stack([np.arange(n - 1), np.arange(1, n)], axis=1), rng.integers(0, n, (chords, 2))])
    ends = ends[ends[:, 0] != ends[:, 1]]
    errors = noise * rng.normal(size=(len(ends), 6)) * SIGMA
    T = se3.between(truth[ends[:, 0]], truth[ends[:, 1]]) @ se3.exp(errors)
    return Edges(ends[:, 0], ends[:, 1], T, np.tile(np.diag(SIGMA**2), (len(ends), 1, 1))), truth


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_without_noise_it_is_the_solution_from_any_start(seed):
    edges, truth = cluttered(seed, 0.0)
    anywhere = se3.exp(np.random.default_rng(seed).normal(size=(len(truth), 6)))
    anywhere[0] = truth[0]
    found = chordal(System.of(edges, anywhere, np.array([0])), anywhere)
    np.testing.assert_allclose(found, truth, atol=1e-5)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_it_costs_about_what_gtsams_does(seed):
    edges, truth = cluttered(seed, 1.0)
    system, graph = System.of(edges, truth, np.array([0])), gtsam.NonlinearFactorGraph()
    noise = gtsam.noiseModel.Diagonal.Sigmas(SIGMA)
    for i, j, T in zip(edges.first.tolist(), edges.second.tolist(), edges.T, strict=True):
        graph.add(gtsam.BetweenFactorPose3(i, j, gtsam.Pose3(T), noise))
    graph.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(truth[0]), gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)))
    values = gtsam.InitializePose3.initialize(graph)
    of_gtsam = system.cost(np.stack([values.atPose3(n).matrix() for n in range(len(truth))]))
    assert system.cost(chordal(system, truth)) < 2.0 * of_gtsam


def test_the_start_given_stays_where_it_costs_less():
    edges, truth = cluttered(1, 1.0)
    system = System.of(edges, truth, np.array([0]))
    solution = system.solved(truth)
    np.testing.assert_array_equal(cheaper_start(system, solution), solution)


def test_parts_that_nothing_joins_are_found_each_by_itself():
    (one, truth), (other, elsewhere) = cluttered(2, 0.0), cluttered(3, 0.0)
    n = len(truth)
    both = one + Edges(other.first + n, other.second + n, other.T, other.covariance)
    poses = np.concatenate([truth, elsewhere])
    bent = poses @ se3.exp(np.random.default_rng(0).normal(size=(2 * n, 6)))
    bent[[0, n]] = poses[[0, n]]
    np.testing.assert_allclose(chordal(System.of(both, bent, np.array([0, n])), bent), poses, atol=1e-5)


def test_each_part_has_the_cheaper_start_of_its_own():
    (one, truth), (other, elsewhere) = cluttered(4, 1.0), cluttered(5, 1.0)
    n = len(truth)
    both = one + Edges(other.first + n, other.second + n, other.T, other.covariance)
    poses, held = np.concatenate([truth, elsewhere]), np.array([0, n])
    poses = System.of(both, poses, held).solved(poses)
    bent = poses.copy()
    bent[n + 1 :] = bent[n + 1 :] @ se3.exp(np.random.default_rng(0).normal(size=(n - 1, 6)))
    start = cheaper_start(System.of(both, bent, held), bent)
    np.testing.assert_array_equal(start[:n], poses[:n])
    np.testing.assert_allclose(start[n:], poses[n:], atol=1.0)


def test_a_start_that_costs_what_true_poses_do_is_not_compared(monkeypatch):
    edges, truth = cluttered(6, 1.0)
    system = System.of(edges, truth, np.array([0]))
    started = []
    monkeypatch.setattr("wiclosure.backends.least_squares.chordal.chordal", lambda _, poses: started.append(1) or poses)
    np.testing.assert_array_equal(cheaper_start(system, truth), truth)
    assert not started
    cheaper_start(system, truth @ se3.exp(np.random.default_rng(0).normal(size=(len(truth), 6))))
    assert started
