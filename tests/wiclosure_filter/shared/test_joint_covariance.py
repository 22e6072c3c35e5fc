"""The factored covariance is the inverse of the information matrix."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest

from wiclosure.wiclosure_filter.shared.joint_covariance import JointCovariance

CHAINS = (9, 7)


def chains_with_links(links: list[tuple[int, int]]) -> tuple[gtsam.GaussianFactorGraph, np.ndarray]:
    """Two chains of poses, joined by random factors."""
    rng = np.random.default_rng(0)
    graph, size = gtsam.GaussianFactorGraph(), sum(CHAINS)

    def random_factor(keys: tuple[int, ...]) -> gtsam.JacobianFactor:
        parts = [part for key in keys for part in (key, 2 * np.eye(6) + 0.3 * rng.normal(size=(6, 6)))]
        return gtsam.JacobianFactor(*parts, np.zeros(6), gtsam.noiseModel.Unit.Create(6))

    for first, length in ((0, CHAINS[0]), (CHAINS[0], CHAINS[1])):
        graph.add(random_factor((first,)))
        for key in range(first, first + length - 1):
            graph.add(random_factor((key, key + 1)))
    for link in links:
        graph.add(random_factor(link))
    linked = np.zeros(size, bool)
    linked[np.ravel(links)] = True
    return graph, linked


@pytest.mark.parametrize("links", [[(2, 11)], [(0, 9), (4, 9), (8, 15)], [(i, 9 + i % 7) for i in range(9)]])
def test_factored_covariance_is_exact(links: list[tuple[int, int]]) -> None:
    graph, linked = chains_with_links(links)
    ordering = gtsam.Ordering()
    for key in range(sum(CHAINS)):
        ordering.push_back(key)
    whole = np.linalg.inv(graph.hessian(ordering)[0]).reshape(16, 6, 16, 6)
    got = JointCovariance.of(graph, linked)
    np.testing.assert_allclose(got.own, np.einsum("ninj->nij", whole), rtol=1e-6, atol=1e-9)
    n, m = (grid.ravel() for grid in np.meshgrid(np.arange(9), np.arange(9, 16), indexing="ij"))
    np.testing.assert_allclose(got.between(n, m), whole[n, :, m], rtol=1e-6, atol=1e-9)
    table = got.of_displacements(slice(0, 9), slice(9, 16), 2)
    both = whole[np.ix_([2], [3, 4], [10], [3, 4])][0, :, 0]
    expected = whole[2, 3:5, 2, 3:5] + whole[10, 3:5, 10, 3:5] - both - both.T
    np.testing.assert_allclose(table[2, 1], expected, rtol=1e-6)


def test_undetermined_poses_are_an_error() -> None:
    graph = gtsam.GaussianFactorGraph()
    graph.add(gtsam.JacobianFactor(0, np.zeros((6, 6)), np.zeros(6), gtsam.noiseModel.Unit.Create(6)))
    with pytest.raises(np.linalg.LinAlgError):
        JointCovariance.of(graph, np.array([True]))
