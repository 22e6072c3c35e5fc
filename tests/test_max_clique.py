from __future__ import annotations

import time

import networkx as nx
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wiclosure.max_clique import max_clique


def random_graph(n: int, density: float, rng: np.random.Generator) -> np.ndarray:
    upper = np.triu(rng.random((n, n)) < density, 1)
    return upper | upper.T


def is_clique(consistent: np.ndarray, members: tuple[int, ...]) -> bool:
    inside = consistent[np.ix_(members, members)]
    return bool((inside | np.eye(len(members), dtype=bool)).all())


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 40), density=st.floats(0, 1))
def test_it_is_as_large_as_networkx_says(seed: int, n: int, density: float) -> None:
    consistent = random_graph(n, density, np.random.default_rng(seed))
    found = max_clique(consistent)
    assert found.proven
    assert is_clique(consistent, found.members)
    assert len(found) == len(nx.max_weight_clique(nx.from_numpy_array(consistent), weight=None)[0])


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(1, 30), density=st.floats(0, 1))
def test_it_weighs_as_much_as_networkx_says(seed: int, n: int, density: float) -> None:
    rng = np.random.default_rng(seed)
    consistent, weights = random_graph(n, density, rng), rng.integers(1, 20, n)
    graph = nx.from_numpy_array(consistent)
    nx.set_node_attributes(graph, dict(enumerate(weights.tolist())), "weight")
    found = max_clique(consistent, weights=weights / 10)
    assert found.proven
    assert is_clique(consistent, found.members)
    assert found.weight == pytest.approx(weights[list(found.members)].sum() / 10)
    assert found.weight == pytest.approx(nx.max_weight_clique(graph, weight="weight")[1] / 10)


def test_equal_weights_find_the_largest() -> None:
    consistent = random_graph(80, 0.5, np.random.default_rng(5))
    alike = max_clique(consistent, weights=np.full(80, 0.3))
    assert alike.members == max_clique(consistent).members
    assert max_clique(consistent).weight == len(alike)


@pytest.mark.parametrize("weights", [[1.0, 2.0], [1.0, -1.0, 1.0], [1.0, 0.0, 1.0], [1.0, np.nan, 1.0]])
def test_weights_that_are_none_are_refused(weights: list[float]) -> None:
    with pytest.raises(ValueError, match="3 positive numbers"):
        max_clique(np.ones((3, 3), bool), weights=np.array(weights))


@pytest.mark.parametrize("density", [0.01, 0.1])
def test_a_planted_clique_is_found_among_a_thousand(density: float) -> None:
    rng = np.random.default_rng(0)
    consistent = random_graph(1000, density, rng)
    planted = np.sort(rng.choice(1000, 30, replace=False))
    consistent[np.ix_(planted, planted)] = True
    found = max_clique(consistent)
    assert found.proven
    assert set(planted.tolist()) <= set(found.members)


def test_when_time_runs_out_it_says_so_and_gives_a_good_clique() -> None:
    consistent = random_graph(600, 0.7, np.random.default_rng(1))
    began = time.perf_counter()
    found = max_clique(consistent, time_budget_s=0.2)
    assert time.perf_counter() - began < 5.0
    assert not found.proven
    assert is_clique(consistent, found.members)
    assert len(found) >= 15  # the maximum is expected at 20 to 25


def test_the_diagonal_does_not_matter() -> None:
    consistent = random_graph(30, 0.4, np.random.default_rng(2))
    assert max_clique(consistent | np.eye(30, dtype=bool)) == max_clique(consistent)


def test_nothing_has_an_empty_clique() -> None:
    assert max_clique(np.zeros((0, 0), bool)).members == ()
    assert len(max_clique(np.zeros((5, 5), bool))) == 1


@pytest.mark.parametrize("shape", [(3,), (2, 3)])
def test_matrices_of_other_shapes_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="expected \\(N, N\\)"):
        max_clique(np.zeros(shape, bool))


def test_an_asymmetric_matrix_is_refused() -> None:
    with pytest.raises(ValueError, match="not symmetric"):
        max_clique(np.triu(np.ones((3, 3), bool), 1))
