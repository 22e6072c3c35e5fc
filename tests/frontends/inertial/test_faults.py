"""Logs that are wrong: stuck, saturated, and in wrong units."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.frontends.inertial import faults
from wiclosure.types import ImuLog


def log(acceleration, rate=None):
    acceleration = np.asarray(acceleration, float)
    return ImuLog(np.arange(len(acceleration), dtype=np.int64) * 10**7, acceleration,
                  np.zeros_like(acceleration) if rate is None else rate)  # fmt: skip


def noisy(count=1000, sigma=0.1):
    return np.array([0, 0, 9.81]) + np.random.default_rng(0).normal(0, sigma, (count, 3))


def test_repeated_samples_are_marked_and_short_repetitions_are_not():
    values = noisy()
    values[100:130] = values[100]  # 0.3 s, as of a driver that fills in
    values[400:500] = values[400]
    marked = faults.stuck(log(values))
    assert np.flatnonzero(marked).tolist() == list(range(400, 500))


def test_clipped_samples_are_marked():
    values = noisy() + np.random.default_rng(1).normal(0, [0.5, 0.5, 10.0], (1000, 3))
    assert not faults.saturated(log(np.clip(values, -1e3, 1e3))).any()
    clipped = np.clip(values, -19.6, 19.6)
    assert (faults.saturated(log(clipped)) == (np.abs(clipped[:, 2]) == 19.6)).all()


@pytest.mark.parametrize(("axis", "low", "high"), [(0, -4.9, 4.9), (1, -9.0, 3.0), (2, 0.0, 11.0)])
@pytest.mark.parametrize("resolution", [1e-9, 0.01, 0.05])
def test_a_range_that_ends_early_is_seen_wherever_it_ends(axis, low, high, resolution):
    values = noisy() + np.random.default_rng(1).normal(0, 3.0, (1000, 3))
    values = np.round(values / resolution) * resolution
    assert not faults.saturated(log(values)).any()
    values[:, axis] = np.clip(values[:, axis], low, high)
    marked = faults.saturated(log(values))
    assert marked[values[:, axis] == high].all()
    assert marked.sum() <= np.isin(values[:, axis], [low, high, -low, -high]).sum()


@pytest.mark.parametrize("sigma", [0.005, 0.02, 0.1, 1.0, 10.0])
@pytest.mark.parametrize("digits", [1, 2, 3, 12])
def test_quantised_values_are_not_clipped(sigma, digits):
    for seed in range(5):
        values = np.array([0, 0, 9.81]) + np.random.default_rng(seed).normal(0, sigma, (3000, 3))
        assert not faults.saturated(log(np.round(values, digits))).any()


@pytest.mark.parametrize(
    ("factor", "word"),
    [
        (1.0, ""),
        (1 / 9.81, "in g"),
        (1000 / 9.81, "thousandths"),
        (1000.0, "thousandths"),
        (0.02, "linear"),
        (3, "9.81"),
    ],
)
def test_units_of_acceleration(factor, word):
    sentence = faults.wrong_unit(log(factor * noisy()))
    assert bool(sentence) == bool(word)
    assert word in sentence


def test_two_rotations_contradict_each_other_beyond_what_is_unsure():
    from scipy.spatial.transform import Rotation

    R = Rotation.from_euler("z", 12, degrees=True).as_matrix()
    assert np.degrees(faults.contradicts(np.eye(3), R, np.radians([0.5, 0.5, 0.5]))) == pytest.approx(12)
    assert faults.contradicts(np.eye(3), R, np.radians([3.0, 3.0, 3.0])) == 0
    assert faults.contradicts(np.eye(3), np.eye(3), np.radians([0.1, 0.1, 0.1])) == 0
