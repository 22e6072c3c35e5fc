"""Poses are eliminated in cliques: each follows what stands above it, and together they are the inverse."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest

from wiclosure.wiclosure_filter.covariance.cliques import Eliminated

from .plan import FIRST, inverse, plan


def test_every_pose_is_in_one_clique_and_follows_those_above_it() -> None:
    cliques = Eliminated.of(plan()).cliques()
    assert sorted(np.concatenate([clique.poses for clique in cliques]).tolist()) == list(range(FIRST[-1]))
    assert 1 < len(cliques) < FIRST[-1] / 2
    above: list[set[int]] = []
    for number, clique in enumerate(cliques):
        assert clique.parent < number  # those above come first
        known = set() if clique.parent < 0 else above[clique.parent]
        assert set(clique.separator.tolist()) <= known
        above.append(known | set(clique.poses.tolist()))


def test_the_root_has_its_covariance_without_the_rest() -> None:
    graph = plan()
    root = Eliminated.of(graph).cliques()[0]
    expected = inverse(graph)[root.poses][:, :, root.poses].reshape(root.remainder.shape)
    np.testing.assert_allclose(root.remainder @ root.remainder.T, expected, rtol=1e-9, atol=1e-12)


def test_the_solution_is_that_of_the_graph() -> None:
    graph = plan()
    expected = graph.optimize()
    for key, moved in enumerate(Eliminated.of(graph).solution()):
        np.testing.assert_allclose(moved, expected.at(key), rtol=1e-8, atol=1e-11)


def test_undetermined_poses_are_an_error() -> None:
    graph = gtsam.GaussianFactorGraph()
    graph.add(gtsam.JacobianFactor(0, np.zeros((6, 6)), np.zeros(6), gtsam.noiseModel.Unit.Create(6)))
    with pytest.raises(np.linalg.LinAlgError):
        Eliminated.of(graph)
