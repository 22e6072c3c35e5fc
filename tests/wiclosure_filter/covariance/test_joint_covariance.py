"""The covariance from the sparse root is the inverse of the information matrix."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.covariance.cliques import Eliminated
from wiclosure.wiclosure_filter.covariance.joint_covariance import JointCovariance
from wiclosure.wiclosure_filter.covariance.square_root import SquareRoot

from .plan import inverse

CHAINS = (9, 7, 3)
FIRST = np.cumsum([0, *CHAINS])
LINKS = [[(2, 11), (11, 17)], [(0, 9), (4, 9), (8, 15), (8, 18)], [(i, 9 + i % 7) for i in range(9)] + [(3, 16)]]


def graph_of(links: list[tuple[int, int]]) -> gtsam.GaussianFactorGraph:
    """Three chains of poses, joined by random factors."""
    rng = np.random.default_rng(0)
    graph = gtsam.GaussianFactorGraph()

    def random_factor(keys: tuple[int, ...]) -> gtsam.JacobianFactor:
        parts = [part for key in keys for part in (key, 2 * np.eye(6) + 0.3 * rng.normal(size=(6, 6)))]
        return gtsam.JacobianFactor(*parts, np.zeros(6), gtsam.noiseModel.Unit.Create(6))

    for first, length in zip(FIRST.tolist(), CHAINS, strict=False):
        graph.add(random_factor((first,)))
        for key in range(first, first + length - 1):
            graph.add(random_factor((key, key + 1)))
    for link in links:
        graph.add(random_factor(link))
    return graph


def axes() -> FloatArray:
    return se3.from_yaw(np.linspace(0, 2, FIRST[-1]), np.zeros((FIRST[-1], 3)))[:, :3, :3]


def both(R: FloatArray) -> FloatArray:
    turn = np.zeros((len(R), 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = R
    return turn


def table(covariance: JointCovariance, a: int, b: int) -> FloatArray:
    return covariance.positions(a, 2).displacements(covariance.positions(b, 2))


def displacement(whole: FloatArray, n: int, m: int) -> FloatArray:
    xy = slice(3, 5)
    return np.asarray(whole[n, xy, n, xy] + whole[m, xy, m, xy] - whole[n, xy, m, xy] - whole[m, xy, n, xy])


@pytest.mark.parametrize("links", LINKS)
def test_blocks_are_those_of_the_inverse(links: list[tuple[int, int]]) -> None:
    graph, ends = graph_of(links), np.array(links)
    turn = both(axes())
    whole = np.einsum("nij,njmk,mlk->niml", turn, inverse(graph), turn)
    got = JointCovariance(SquareRoot.of(Eliminated.of(graph)), FIRST, axes(), (ends[:, 0], ends[:, 1]))
    for robot, (alone, with_second) in enumerate(got.about(range(3), [1, 1, 1])):
        own = np.arange(FIRST[robot], FIRST[robot + 1])
        np.testing.assert_allclose(alone, whole[own, :, own], rtol=1e-8, atol=1e-12)
        np.testing.assert_allclose(with_second, whole[own, :, own[1]], rtol=1e-8, atol=1e-12)
    n, m = np.concatenate([[(0, 10), (5, 9), (5, 15), (8, 10)], ends]).T  # some that a factor joins
    for block, expected in zip(got.of_pairs(n, m), (whole[n, :, n], whole[n, :, m], whole[m, :, m]), strict=True):
        np.testing.assert_allclose(block, expected, rtol=1e-8, atol=1e-12)
    for learned in (False, True):
        if learned:
            got.learn(np.array([12, 3]), [np.array([17]), np.array([15, 12])])
        for pair in ([3, 12], [12, 17]):
            two = whole[pair][:, :, pair].reshape(12, 12)
            np.testing.assert_allclose(got.of_two(*pair), two, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(table(got, 0, 1)[2, 1], displacement(whole, 2, 10), rtol=1e-8)
    np.testing.assert_allclose(table(got, 1, 2)[6, 0], displacement(whole, 15, 16), rtol=1e-8)


@pytest.mark.parametrize("links", LINKS)
def test_chains_have_the_blocks_of_neighbours(links: list[tuple[int, int]]) -> None:
    graph = graph_of(links)
    whole = inverse(graph)
    n = np.arange(FIRST[-1])
    own, following = SquareRoot.of(Eliminated.of(graph)).near(n[:-1], n[1:])
    np.testing.assert_allclose(own, np.einsum("ninj->nij", whole), rtol=1e-8, atol=1e-12)
    for key in set(range(FIRST[-1] - 1)) - set((FIRST - 1).tolist()):
        np.testing.assert_allclose(following[key], whole[key, :, key + 1], rtol=1e-8, atol=1e-12)


def test_the_solution_is_that_of_the_graph() -> None:
    graph = graph_of(LINKS[1])
    pull = np.random.default_rng(2).normal(size=6)
    graph.add(gtsam.JacobianFactor(4, np.eye(6), pull, gtsam.noiseModel.Unit.Create(6)))
    expected = np.einsum("nij,j->ni", inverse(graph)[:, :, 4], pull)
    np.testing.assert_allclose(Eliminated.of(graph).solution(), expected, rtol=1e-8, atol=1e-12)


def test_undetermined_poses_are_an_error() -> None:
    graph = gtsam.GaussianFactorGraph()
    graph.add(gtsam.JacobianFactor(0, np.zeros((6, 6)), np.zeros(6), gtsam.noiseModel.Unit.Create(6)))
    with pytest.raises(np.linalg.LinAlgError):
        SquareRoot.of(Eliminated.of(graph))
