"""Factors without some edges against the normal matrix of the others."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.backends.least_squares.downdated import Downdated
from wiclosure.backends.least_squares.normal_matrix import NormalMatrix

NODES, HELD = 20, np.array([0])


def team(rng, extra):
    """Edges of a chain and others, with derivatives of any kind."""
    first = np.r_[np.arange(NODES - 1), rng.integers(0, NODES // 2, extra)]
    second = np.r_[np.arange(1, NODES), rng.integers(NODES // 2, NODES, extra)]
    A, B = rng.normal(size=(2, len(first), 6, 6))
    return first, second, A, B


def factorised(first, second, A, B):
    return NormalMatrix.of(first, second, NODES).factorised(A, B, np.ones(len(first)), HELD, 0.0)


def without(factors, of, gone):
    first, second, A, B = (a[gone] for a in of)
    return Downdated.without(factors, first, second, (A, B), NODES)


@pytest.mark.parametrize("seed", range(5))
def test_it_solves_as_the_matrix_of_the_other_edges(seed):
    rng = np.random.default_rng(seed)
    of = team(rng, 15)
    gone = np.arange(len(of[0])) % 3 == 2
    gone[: NODES - 1] = False
    right = rng.normal(size=(NODES, 6, 3))
    right[HELD] = 0.0
    left = factorised(*(a[~gone] for a in of))
    found = without(factorised(*of), of, gone)
    np.testing.assert_allclose(found.solve(right), left.solve(right), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found.solve(right[..., 0]), left.solve(right[..., 0]), rtol=1e-6, atol=1e-8)


def test_edges_go_one_after_another():
    rng = np.random.default_rng(5)
    of, right = team(rng, 15), rng.normal(size=(NODES, 6))
    right[HELD] = 0.0
    every, some = np.arange(len(of[0])), np.arange(len(of[0])) != 22
    once = without(factorised(*of), of, every == 22)
    twice = without(once, [a[some] for a in of], (every == 30)[some])
    at_once = without(factorised(*of), of, (every == 22) | (every == 30))
    np.testing.assert_allclose(twice.solve(right), at_once.solve(right), rtol=1e-6, atol=1e-8)


def test_solutions_are_restated_for_the_edges_that_are_left():
    rng = np.random.default_rng(6)
    of, gone = team(rng, 15), np.arange(NODES - 1 + 15) >= 30
    first, second, A, B = of
    residuals, gradient = rng.normal(size=(len(first), 6, 4)), np.zeros((NODES, 6, 4))
    left = gradient.copy()
    for nodes, J in ((first, A), (second, B)):
        np.add.at(gradient, nodes, np.swapaxes(J, 1, 2) @ residuals)
        np.add.at(left, nodes[~gone], np.swapaxes(J[~gone], 1, 2) @ residuals[~gone])
    gradient[HELD] = left[HELD] = 0.0
    whole = factorised(*of)
    found = without(whole, of, gone).less(whole.solve(-gradient), residuals[gone])
    np.testing.assert_allclose(found, factorised(*(a[~gone] for a in of)).solve(-left), atol=1e-7)


def test_an_edge_that_alone_holds_its_end_cannot_go():
    of = team(np.random.default_rng(7), 0)
    assert without(factorised(*of), of, np.arange(NODES - 1) == 4) is None
