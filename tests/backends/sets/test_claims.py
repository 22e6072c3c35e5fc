from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.sets.chance import chance_distances
from wiclosure.backends.sets.claims import Claims

SIGMA = np.repeat([0.01, 0.1], 3)


def claims(rng, n, *, unrelated=False):
    """Closures between two rigid paths in one frame."""
    T_a, T_b = (se3.from_yaw(rng.uniform(-3, 3, n), rng.normal(0, 20, (n, 3))) for _ in range(2))
    T = se3.between(T_a, T_b) @ se3.exp(rng.normal(size=(n, 6)) * SIGMA)
    if unrelated:
        T = T[rng.permutation(n)]
    rigid = np.zeros((n, 6, 100))
    return Claims(T_a, T_b, T, np.tile(np.diag(SIGMA**2), (n, 1, 1)), rigid, rigid)


def test_distances_of_true_closures_are_chi_square():
    found = claims(np.random.default_rng(0), 60).distances(np.arange(60), beyond=1e9)
    pairs = found[np.triu_indices(60, 1)]
    assert np.mean(pairs) == pytest.approx(6.0, rel=0.15)
    np.testing.assert_allclose(found, found.T, rtol=1e-6)


def test_what_lies_beyond_is_left_out_and_nothing_nearer():
    of = claims(np.random.default_rng(1), 40, unrelated=True)
    exact, cut = of.distances(np.arange(40), beyond=1e12), of.distances(np.arange(40), beyond=100.0)
    assert (exact[np.isinf(cut)] > 100.0).all()
    np.testing.assert_allclose(cut[np.isfinite(cut)], exact[np.isfinite(cut)])


def test_neighbours_bound_the_closures_that_agree():
    of = claims(np.random.default_rng(4), 60)
    agreeing = (of.distances(np.arange(60), beyond=1e9) <= 16.8).sum(axis=1)
    assert (of.neighbours(16.8) >= agreeing).all()
    assert np.median(claims(np.random.default_rng(4), 60, unrelated=True).neighbours(16.8)) < 5 < agreeing.min()


def test_the_mean_frame_is_as_sharp_as_its_closures_together():
    """Errors of many teams are as the covariance says: chi-square with six degrees of freedom."""
    rng, n, distances = np.random.default_rng(6), 9, []
    for _ in range(200):
        frame, noise, wander = claims(rng, n).mean_frame(np.arange(n), 0)
        error = se3.log(frame[None])[0]
        distances.append(error @ np.linalg.solve(noise + wander @ wander.T, error))
        assert np.trace(noise) < np.trace(claims(rng, n).noise[0])
    assert np.mean(distances) == pytest.approx(6.0, rel=0.15)


def test_errors_that_the_ends_share_stay_in_the_mean_frame():
    """Averaging takes nothing away from what all closures have in common."""
    of = claims(np.random.default_rng(7), 9)
    drift = np.tile(np.random.default_rng(8).normal(0, [*3 * [0.001], *3 * [1.0]], (100, 6)).T, (9, 1, 1))
    shared = Claims(of.T_A_a, of.T_B_b, of.T_a_b, of.covariance, drift, np.zeros_like(drift))
    _, noise, wander = shared.mean_frame(np.arange(9), 0)
    alone = shared.wander[0]
    np.testing.assert_allclose(wander @ wander.T, alone @ alone.T, rtol=0.1, atol=0.01)
    assert np.trace(noise) < np.trace(shared.noise.mean(axis=0))


def flat_claims(n=20, samples=100):
    """Between two paths in the plane, whose ends err there."""
    rng = np.random.default_rng(5)
    T_a, T_b, T = (se3.from_yaw(rng.uniform(-3, 3, n), rng.normal(0, 20, (n, 3)) * [1.0, 1.0, 0.0]) for _ in range(3))
    wander_a, wander_b = np.zeros((2, n, 6, samples))
    wander_a[:, 2:5], wander_b[:, 2:5] = 0.1 * rng.normal(size=(2, n, 3, samples))
    return Claims(T_a, T_b, T, np.tile(np.diag(SIGMA**2), (n, 1, 1)), wander_a, wander_b)


def test_in_the_plane_three_components_tell_what_six_do():
    flat = flat_claims()
    full = replace(flat, known_flat=False)
    assert (flat.flat, len(flat.free), len(full.free)) == (True, 3, 6)
    rows = np.arange(len(flat))
    np.testing.assert_allclose(flat.distances(rows, 1e12), full.distances(rows, 1e12), rtol=1e-6)
    np.testing.assert_allclose(flat.wander, full.wander, atol=1e-12)
    np.testing.assert_allclose(flat.frame_covariance, full.frame_covariance, atol=1e-12)
    np.testing.assert_allclose(chance_distances(flat), chance_distances(full), rtol=1e-6)


@pytest.mark.parametrize("name", ["T_A_a", "T_B_b", "T_a_b", "covariance", "wander_a", "wander_b"])
def test_whatever_leaves_the_plane_takes_six(name):
    flat = flat_claims()
    out = getattr(flat, name).copy()
    if name.startswith("T"):
        out[3, 2, 3] = 0.1
    elif name == "covariance":
        out[3, 0, 2] = out[3, 2, 0] = 1e-5
    else:
        out[3, 5, 7] = 0.1
    assert not replace(flat, **{name: out}).flat
