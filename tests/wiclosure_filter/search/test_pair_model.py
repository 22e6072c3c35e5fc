"""Displacements between keyframes by a coarse table: exact at nodes, blended between, bounded over rectangles."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.wiclosure_filter.search.gates import spread
from wiclosure.wiclosure_filter.search.pair_model import Extremes, KeyframePlaces, PairModel, ShortestRoutes

from .random_places import random_places


def small_model() -> PairModel:
    """Three keyframes of a between two nodes, two of b at one node."""
    a = KeyframePlaces(
        np.array([[0.0, 0.0], [5.0, 0.0], [10.0, 0.0]]),
        np.stack([np.zeros((2, 2)), 0.5 * np.eye(2), np.zeros((2, 2))]),
        np.array([0, 0, 1]),
        np.array([0.0, 0.5, 0.0]),
    )
    b = KeyframePlaces(np.array([[0.0, 3.0], [0.0, 4.0]]), np.tile(np.eye(2), (2, 1, 1)), np.zeros(2, int), np.zeros(2))
    return PairModel(a, b, np.stack([[2.0 * np.eye(2)], [6.0 * np.eye(2)]]))


def test_displacements_are_differences_of_places() -> None:
    model = small_model()
    np.testing.assert_allclose(model.displacement(np.array([1, 2]), np.array([0, 1])), [[-5.0, 3.0], [-10.0, 4.0]])


def test_covariances_are_those_of_the_nodes_blended_plus_each_ones_own() -> None:
    covariance = small_model().covariance(np.array([0, 1, 2]), np.array([0, 0, 1]))
    np.testing.assert_allclose(covariance[:, 0, 0], [2.0 + 1.0, 4.0 + 0.5 + 1.0, 6.0 + 1.0])
    np.testing.assert_allclose(covariance[:, 0, 1], 0.0)


def test_own_variance_is_the_largest_in_any_direction() -> None:
    C = np.array([[[2.0, 1.0], [1.0, 2.0]]])
    places = KeyframePlaces(np.zeros((1, 2)), C, np.zeros(1, int), np.zeros(1))
    np.testing.assert_allclose(places.own_variance, 3.0)


@settings(max_examples=100, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1), d=st.sampled_from([2, 3]))
def test_bounds_hold_for_every_pair_of_a_rectangle(seed: int, d: int) -> None:
    rng = np.random.default_rng(seed)
    nodes_a, nodes_b = rng.integers(1, 9, 2)
    a, b = (random_places(rng, rng.integers(2, 60), nodes, d, 50.0) for nodes in (nodes_a, nodes_b))
    root = rng.normal(size=(nodes_a, nodes_b, d, d))
    model = PairModel(a, b, root @ np.swapaxes(root, 2, 3) + 1e-3 * np.eye(d))
    first_a, last_a = np.sort(rng.integers(0, len(a), 2))
    first_b, last_b = np.sort(rng.integers(0, len(b), 2))
    largest, smallest = model.bounds(*(np.array([end]) for end in (first_a, last_a, first_b, last_b)))
    p, k = (x.ravel() for x in np.meshgrid(np.arange(first_a, last_a + 1), np.arange(first_b, last_b + 1)))
    of_table = model.covariance(p, k) - a.own_covariance[p] - b.own_covariance[k]
    variance, size = spread(of_table)
    assert variance.max() <= largest[0] * (1 + 1e-6)
    assert size.min() >= smallest[0] * (1 - 1e-6)


def test_each_pair_is_answered_by_its_shortest_route() -> None:
    to_a, to_b = np.array([[0.0, 9.0], [5.0, 1.0]]), np.array([[1.0, 7.0], [2.0, 2.0]])
    p, k = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    over = [ShortestRoutes(to_a, to_b, link).shortest_here(p, k).tolist() for link in (0, 1)]
    assert over[0] == [True, True, False, False]  # lengths 1 and 7, 7 and 7 (the first of equals), 10 and 3, 16 and 3
    assert over[1] == [False, False, True, True]


@settings(max_examples=300, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_extremes_cover_the_rectangle(seed: int) -> None:
    rng = np.random.default_rng(seed)
    table = rng.normal(size=rng.integers(1, 40, 2))
    rows, columns = (np.sort(rng.integers(0, n, (2, 30)), axis=0) for n in table.shape)
    largest, smallest = Extremes.of(table, table).over(rows[0], rows[1], columns[0], columns[1])
    for i in range(30):
        inside = table[rows[0, i] : rows[1, i] + 1, columns[0, i] : columns[1, i] + 1]
        assert largest[i] >= inside.max()
        assert smallest[i] <= inside.min()
