from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.sets.chance import Recombined, chance_distances, chance_to_agree
from wiclosure.backends.sets.claims import Claims

SIGMA = np.repeat([0.01, 0.1], 3)


def claims(rng, n, *, unrelated=False, wander=0.0):
    """Closures between two paths in one frame, rigid or erring."""
    T_a, T_b = (se3.from_yaw(rng.uniform(-3, 3, n), rng.normal(0, 20, (n, 3))) for _ in range(2))
    T = se3.between(T_a, T_b) @ se3.exp(rng.normal(size=(n, 6)) * SIGMA)
    if unrelated:
        T = T[rng.permutation(n)]
    ends = wander * rng.normal(size=(2, n, 6, 100))
    return Claims(T_a, T_b, T, np.tile(np.diag(SIGMA**2), (n, 1, 1)), *ends)


def test_recombined_closures_are_as_far_apart_as_if_they_had_been_measured():
    rng = np.random.default_rng(9)
    of, (rows, ends) = claims(rng, 40, wander=0.02), rng.integers(0, 40, (2, 80))
    made = Recombined(of, rows, ends)
    measured = Claims(
        of.T_A_a[rows], of.T_B_b[ends], of.T_a_b[rows], of.covariance[rows], of.wander_a[rows], of.wander_b[ends]
    )
    one, other = rng.permutation(80)[:70], rng.permutation(80)[:70]
    expected = measured.distances(np.arange(80), beyond=1e12)[one, other]
    np.testing.assert_allclose(made.distances(one, other)[one != other], expected[one != other], rtol=1e-9)


def test_chance_is_told_without_the_agreement_of_true_closures():
    rng = np.random.default_rng(2)
    true, false = (chance_to_agree(chance_distances(claims(rng, 100, unrelated=u)), 16.8, 100) for u in (False, True))
    assert 1e-10 < true < 1e-6  # counted in a hundred times as many: 3e-8 and 1e-7
    assert 1e-10 < false < 1e-6


def test_closures_of_one_spot_agree_however_they_are_recombined():
    """They do not differ by more than their noise, so that their agreement says nothing."""
    rng = np.random.default_rng(3)
    n = 10
    here = np.tile(np.eye(4), (n, 1, 1)) @ se3.exp(rng.normal(size=(n, 6)) * 0.001)
    T = se3.exp(rng.normal(size=(n, 6)) * SIGMA)
    rigid = np.zeros((n, 6, 100))
    of = Claims(here, here, T, np.tile(np.diag(SIGMA**2), (n, 1, 1)), rigid, rigid)
    assert chance_to_agree(chance_distances(of), 16.8, n) > 0.9


@pytest.mark.parametrize(("dimensions", "magnitude"), [(6, -6), (4, -4), (2, -2)])
def test_a_chance_too_small_to_count_falls_with_the_volume(dimensions, magnitude):
    """In as many dimensions as unrelated frames fill: ground robots do not roll."""
    drawn = np.random.default_rng(4).uniform(0.0, 1.0, (30, 1000))
    distances = np.sort(drawn, axis=1) ** (2 / dimensions) * 1e4
    found = np.log10([chance_to_agree(of, 100.0, 100) for of in distances])
    assert np.median(found) == pytest.approx(magnitude, abs=0.5)


def test_without_recombined_closures_anything_may_be_chance():
    assert chance_to_agree(np.zeros(0), 16.8, 1) == 1.0


def test_recombined_closures_no_distance_apart_are_no_fault():
    """Where each closure is given several times; a quotient of their distances would overflow."""
    apart = np.concatenate([np.zeros(2), np.linspace(100.0, 1e4, 5000)])
    assert 0.0 < chance_to_agree(apart, 16.8, 200) < 0.1
