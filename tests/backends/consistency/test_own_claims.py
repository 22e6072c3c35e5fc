"""Which own loops odometry refutes and which neighbours support, on a street driven up and down."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.closure_sets import closure_sets
from wiclosure.backends.config import ClosureNoise
from wiclosure.backends.consistency.own_claims import OwnClaims
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.types import Closure, KeyframeId, Trajectory

EXACT = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)
SIGMA, STEP = np.repeat([0.01, 0.05], 3), np.repeat([0.001, 0.02], 3)
LIMIT = float(chi2.ppf(0.99, 6))
N = 200


def street(rng, slip_m=0.0):
    """True poses 100 m out and back again, and odometry of them that loses `slip_m` ahead half-way."""
    tangents = np.zeros((N - 1, 6))
    tangents[:, 3], tangents[N // 2, 2] = 1.0, np.pi
    truth, path = [np.eye(4)], [np.eye(4)]
    for n, step in enumerate(se3.exp(tangents)):
        lost = se3.from_yaw(0.0, np.array([slip_m if n == N // 4 else 0.0, 0.0, 0.0]))
        truth.append(truth[-1] @ step)
        path.append(path[-1] @ step @ lost @ se3.exp(rng.normal(size=6) * STEP))
    steps = np.tile(np.diag(STEP**2), (N - 1, 1, 1))
    odometry = Trajectory("a", np.arange(N) * 10**9, np.stack(path), step_covariances=steps)
    return np.stack(truth), odometry


def loops_of(rng, truth, ends, false=0):
    """Loops between `ends (L, 2)`, either way round; so many more from anywhere to anywhere."""
    measured = [(i, j, se3.between(truth[i], truth[j]) @ se3.exp(rng.normal(size=6) * SIGMA)) for i, j in ends]
    for i, j in rng.integers(0, N, (false, 2)):
        measured.append((i, j, se3.exp(rng.normal(size=6) * [1.0, 1.0, 1.0, 3.0, 3.0, 3.0])))
    return [
        Closure.from_measurement(KeyframeId("a", int(i)), KeyframeId("a", int(j)), T, np.diag(SIGMA**2))
        for i, j, T in measured
    ]


def claims_of(closures, odometry):
    sets, _ = closure_sets(closures, {"a": odometry}, EXACT)
    team = TeamArrays.of({"a": odometry}, sets, np.zeros(len(closures), bool))
    return OwnClaims.of(team.robots), team


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.fixture
def across(rng):
    """Places that the way back passes again, every other one seen backwards."""
    out = rng.choice(np.arange(5, 90), 40, replace=False)
    ends = np.stack([out, N - out], axis=1)
    ends[::2] = ends[::2, ::-1]
    return ends


def test_odometry_refutes_most_false_loops_and_no_true_one(rng, across):
    truth, odometry = street(rng)
    own, team = claims_of(loops_of(rng, truth, across, false=60), odometry)
    refuted, true = own.refuted(LIMIT), team.rows < len(across)
    assert refuted[true].mean() <= 0.1
    assert refuted[~true].mean() >= 0.9


def test_odometry_is_as_uncertain_as_its_steps_state(rng):
    """Half of all loops lie within the median of chi-square, however long the way between their ends."""
    refuted = []
    for _ in range(30):
        truth, odometry = street(rng)
        own, _ = claims_of(loops_of(rng, truth, [(0, 30), (10, 100), (0, 199)]), odometry)
        refuted.append(own.refuted(chi2.ppf(0.5, 6)))
    np.testing.assert_allclose(np.mean(refuted, axis=0), 0.5, atol=0.25)


def test_neighbours_support_true_loops_even_where_odometry_has_slipped(rng, across):
    truth, odometry = street(rng, slip_m=5.0)
    own, team = claims_of(loops_of(rng, truth, across, false=60), odometry)
    true = team.rows < len(across)
    assert own.refuted(LIMIT)[true].mean() >= 0.5
    assert own.supported(LIMIT)[true].mean() >= 0.9
    assert own.supported(LIMIT)[~true].mean() <= 0.05


@pytest.mark.parametrize("count", [1, 2])
def test_few_loops_support_nothing(rng, across, count):
    truth, odometry = street(rng)
    own, _ = claims_of(loops_of(rng, truth, across[:count]), odometry)
    assert not own.supported(LIMIT).any()
