from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.least_squares.edges import Edges
from wiclosure.backends.least_squares.settling import settle
from wiclosure.backends.least_squares.variance_components import VarianceComponents, restated, separate_factors

ANY = np.zeros(2), np.full(2, np.inf)
SIGMA = np.repeat([0.01, 0.2], 3)


@pytest.mark.parametrize(("rotation", "translation"), [(0.01, 0.2), (0.3, 0.1), (0.002, 5.0)])
def test_rotation_and_translation_are_told_apart_where_both_are_stated_as_one(rotation, translation):
    """A wandering path with loops, drawn with other standard deviations than the edges state."""
    rng, n = np.random.default_rng(0), 60
    truth = se3.from_rotation_translation(se3.exp(rng.normal(size=(n, 6)))[:, :3, :3], rng.normal(0, 10, (n, 3)))
    ends = np.concatenate([np.stack([np.arange(n - 1), np.arange(1, n)], axis=1), rng.integers(0, n, (80, 2))])
    ends = np.sort(ends[ends[:, 0] != ends[:, 1]], axis=1)
    noise = se3.exp(rng.normal(size=(len(ends), 6)) * SIGMA)
    T = se3.between(truth[ends[:, 0]], truth[ends[:, 1]]) @ noise
    stated = np.diag(np.repeat([rotation, translation], 3) ** 2)
    edges = Edges(ends[:, 0], ends[:, 1], T, np.tile(stated, (len(ends), 1, 1)))

    def under(factors):
        of = Edges(edges.first, edges.second, edges.T, restated(edges.covariance, factors))
        loops = np.ones(len(of) - n + 1, bool)
        parts = of.subset(np.arange(n - 1)), of.subset(np.arange(n - 1, len(of)))
        return settle(*parts, loops, loops, truth, np.array([0]), np.inf).components

    factors = separate_factors(under(np.ones(2)), under, ANY)
    np.testing.assert_allclose(factors * [rotation, translation], [0.01, 0.2], rtol=0.15)


def test_factors_much_alike_are_one_and_too_little_redundancy_has_none():
    def never(factors):
        raise AssertionError(factors)

    alike = VarianceComponents(np.array([100.0, 200.0]), np.array([100.0, 100.0]))
    np.testing.assert_array_equal(separate_factors(alike, never, ANY), np.ones(2))
    np.testing.assert_allclose(VarianceComponents(np.array([400.0, 9.0]), np.array([100.0, 5.0])).factors, [2.0, 1.0])


def test_factors_end_where_they_must_and_are_not_asked_for_beyond():
    none = VarianceComponents(np.array([1e-9, 1e-9]), np.array([100.0, 100.0]))
    exact = VarianceComponents(np.array([1e-9, 100.0]), np.array([100.0, 100.0]))
    bounds = np.array([0.1, 0.1]), np.array([10.0, 10.0])
    np.testing.assert_allclose(separate_factors(exact, lambda factors: exact, bounds), [0.1, 1.0])
    np.testing.assert_array_equal(separate_factors(none, lambda factors: none, bounds), np.ones(2))


def test_planar_residuals_have_one_of_rotation_and_two_of_translation():
    components = VarianceComponents.of(np.ones((7, 6)), np.full((7, 6), 2.0), 3)
    assert components.squared.tolist() == [7.0, 14.0]
    assert components.redundancy.tolist() == [14.0, 28.0]


def test_covariances_are_restated_by_one_factor_or_two():
    full = np.arange(36.0).reshape(6, 6)
    np.testing.assert_allclose(restated(full, 2.0), 4.0 * full)
    apart = restated(full, np.array([2.0, 3.0]))
    np.testing.assert_allclose(apart[:3, :3], 4.0 * full[:3, :3])
    np.testing.assert_allclose(apart[:3, 3:], 6.0 * full[:3, 3:])
