from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, chi2

from wiclosure import se3
from wiclosure.backends.sets import alignment
from wiclosure.backends.sets.alignment import FEW, ClosureComparison, log_expected
from wiclosure.backends.sets.chance import chance_distances, chance_to_agree
from wiclosure.backends.sets.claims import Claims

SIGMA = np.repeat([0.01, 0.1], 3)
LIMIT = float(chi2.ppf(0.99, 6))
SHIFT = se3.from_yaw(0.5, np.array([25.0, -8.0, 0.0]))


def compared(rng, sizes, *, unrelated=0, noise=1.0):
    """Closures of as many sets as sizes, each with the second frame elsewhere, then unrelated ones."""
    n = sum(sizes) + unrelated
    T_a, T_b = (se3.from_yaw(rng.uniform(-3, 3, n), rng.normal(0, 20, (n, 3))) for _ in range(2))
    powers = np.reshape([np.linalg.matrix_power(SHIFT, k) for k in range(len(sizes))], (-1, 4, 4))
    shift = np.repeat(powers, np.array(sizes, int), axis=0)
    T = se3.between(T_a[: sum(sizes)], shift @ T_b[: sum(sizes)])
    T = np.concatenate([T, se3.from_yaw(rng.uniform(-3, 3, unrelated), rng.normal(0, 5, (unrelated, 3)))])
    T = T @ se3.exp(noise * rng.normal(size=(n, 6)) * SIGMA)
    rigid = np.zeros((n, 6, 100))
    return ClosureComparison.of(Claims(T_a, T_b, T, np.tile(np.diag(SIGMA**2), (n, 1, 1)), rigid, rigid), LIMIT)


def test_the_two_sets_are_found_whole_and_the_larger_first():
    found = compared(np.random.default_rng(0), (6, 9), unrelated=20, noise=0.3).consistent_sets(LIMIT)
    assert found[0].rows.tolist() == list(range(6, 15))
    assert found[1].rows.tolist() == list(range(6))
    assert all(h.medoid in h.rows for h in found)
    assert all(h.total == 35 for h in found)


def test_chance_explains_unrelated_closures_and_no_true_set():
    rng = np.random.default_rng(1)
    true, false = (compared(rng, sizes, unrelated=n).consistent_sets(LIMIT) for sizes, n in (((10,), 20), ((), 30)))
    assert true[0].log_chance < np.log(1e-6)
    assert all(h.log_chance > np.log(0.005) for h in false)


def test_no_closure_is_in_two_sets():
    rows = np.concatenate(
        [h.rows for h in compared(np.random.default_rng(2), (5, 5, 5), unrelated=9).consistent_sets(LIMIT)]
    )
    assert len(np.unique(rows)) == len(rows)


def test_of_few_closures_each_may_be_a_set_of_its_own():
    found = compared(np.random.default_rng(3), (), unrelated=FEW).consistent_sets(LIMIT)
    assert sorted(h.rows.tolist() for h in found) == [[n] for n in range(FEW)]
    mixed = compared(np.random.default_rng(3), (FEW - 1,), unrelated=1, noise=0.3).consistent_sets(LIMIT)
    assert [h.rows.tolist() for h in mixed] == [[0, 1, 2], [3]]


def test_closures_that_are_no_anchors_belong_as_well(monkeypatch):
    monkeypatch.setattr(alignment, "ANCHORS", 10)
    comparison = compared(np.random.default_rng(4), (30,), noise=0.3)
    assert comparison.between_anchors.shape == (10, 10)
    assert comparison.distances(np.array([3, 7])).shape == (2, 30)
    assert comparison.consistent_sets(LIMIT)[0].rows.tolist() == list(range(30))


def test_the_chance_is_the_binomial_tail_times_the_closures_it_may_start_from():
    assert log_expected(4, 10, 0.1) == pytest.approx(np.log(10 * sum(binom.pmf(k, 9, 0.1) for k in range(3, 10))))
    alone = compared(np.random.default_rng(3), (), unrelated=FEW).consistent_sets(LIMIT)[0]
    assert alone.log_chance == pytest.approx(np.log(FEW))


def test_the_chance_is_told_when_it_is_asked_for():
    comparison = compared(np.random.default_rng(0), (6,), unrelated=20, noise=0.3)
    largest = comparison.consistent_sets(LIMIT)[0]
    assert "recombined" not in vars(comparison)
    p = chance_to_agree(chance_distances(comparison.claims), LIMIT, 26, comparison.claims.degrees)
    assert largest.log_chance == log_expected(len(largest), 26, p)


def test_a_small_true_set_among_thousands_is_found():
    """Two closures of a hundred, and of them next to none among any few hundred that are picked evenly."""
    largest = compared(np.random.default_rng(5), (40,), unrelated=2000, noise=0.3).consistent_sets(LIMIT)[0]
    assert np.isin(np.arange(40), largest.rows).all()
    assert len(largest) <= 42
    assert largest.log_chance < np.log(0.005)


def test_distances_between_anchors_are_computed_once(monkeypatch):
    monkeypatch.setattr(alignment, "ANCHORS", 10)
    of = compared(np.random.default_rng(4), (12, 9), unrelated=9)
    exact = of.claims.distances(of.anchors, LIMIT)
    asked, distances = [], Claims.distances

    def counted(self, rows, beyond, others=None):
        asked.append(others)
        return distances(self, rows, beyond, others)

    monkeypatch.setattr(Claims, "distances", counted)
    np.testing.assert_allclose(of.distances(np.arange(10)), exact)
    assert len(asked) == 1
    assert not np.isin(asked[0], of.anchors).any()
