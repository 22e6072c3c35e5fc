from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import Trajectory


def drive(seed: int, n: int = 30, drift: DriftModel | None = None) -> Trajectory:
    steps = se3.exp(np.random.default_rng(seed).normal(0.0, [0.1, 0.1, 0.3, 1.0, 0.3, 0.1], (n - 1, 6)))
    poses = [np.eye(4)]
    for step in steps:
        poses.append(poses[-1] @ step)
    return Trajectory("alpha", np.arange(n) * 10**9, np.array(poses), drift or DriftModel())


BIASED = DriftModel(translation_bias=0.01, rotation_bias=0.0005)


@given(seed=st.integers(0, 10_000), ends=st.tuples(st.integers(0, 29), st.integers(0, 29)))
def test_covariance_is_that_of_adding_up_the_steps(seed: int, ends: tuple[int, int]) -> None:
    trajectory = drive(seed)
    i, j = sorted(ends)
    expected = np.zeros((6, 6))
    for k in range(i, j):
        T = trajectory.relative_pose(np.array([k]), np.array([k + 1]))[0]
        length, turn = float(np.linalg.norm(T[:3, 3])), float(se3.rotation_angle(T))
        drift = trajectory.drift
        rotation = drift.rotation_walk**2 * length + drift.rotation_walk_turning**2 * turn
        step = np.diag(np.repeat([rotation, drift.translation_walk**2 * length], 3))
        expected = se3.compose_covariance(expected, T, step)
    np.testing.assert_allclose(trajectory.relative_covariance(np.array([i]), np.array([j]))[0], expected, atol=1e-12)


@pytest.mark.parametrize("drift", [DriftModel(), BIASED])
@given(seed=st.integers(0, 10_000), ends=st.tuples(st.integers(0, 29), st.integers(0, 29)))
def test_there_and_back_say_the_same(drift: DriftModel, seed: int, ends: tuple[int, int]) -> None:
    trajectory = drive(seed, drift=drift)
    i, j = np.array([ends[0]]), np.array([ends[1]])
    there, back = trajectory.relative_covariance(i, j), trajectory.relative_covariance(j, i)
    np.testing.assert_allclose(se3.inverse_covariance(trajectory.relative_pose(i, j), there), back, atol=1e-9)
    assert np.linalg.eigvalsh(there).min() >= -1e-12


def test_the_choice_of_the_odometry_frame_does_not_matter() -> None:
    trajectory = drive(1, drift=BIASED)
    moved = trajectory.moved(se3.exp(np.array([0.3, -0.2, 2.0, 50.0, -20.0, 3.0])))
    i, j = np.array([0, 3, 20]), np.array([29, 9, 5])
    np.testing.assert_allclose(moved.relative_covariance(i, j), trajectory.relative_covariance(i, j), atol=1e-9)


def test_simulated_drift_has_the_stated_covariance() -> None:
    drift = DriftModel(translation_walk=0.02, rotation_walk=0.002, rotation_walk_turning=0.004)
    trajectory = drive(2, drift=drift)
    rng = np.random.default_rng(0)
    steps = trajectory.relative_pose(np.arange(29), np.arange(1, 30))
    length, turn = np.linalg.norm(steps[:, :3, 3], axis=1), se3.rotation_angle(steps)
    rotation = np.sqrt(drift.rotation_walk**2 * length + drift.rotation_walk_turning**2 * turn)
    sigma = np.repeat(np.stack([rotation, drift.translation_walk * np.sqrt(length)], axis=1), 3, axis=1)
    T = np.broadcast_to(np.eye(4), (4000, 4, 4))
    for step, s in zip(steps, sigma, strict=True):
        T = T @ step @ se3.exp(rng.normal(0.0, s, (4000, 6)))
    expected = trajectory.relative_covariance(np.array([0]), np.array([29]))[0]
    error = se3.log(se3.inverse(trajectory.relative_pose(np.array([0]), np.array([29]))) @ T)
    nees = np.einsum("ni,ij,nj->n", error, np.linalg.inv(expected), error)
    assert nees.mean() == pytest.approx(6.0, rel=0.1)


@pytest.mark.parametrize(
    "values", [{"translation_walk": 0.0}, {"rotation_walk": -1.0}, {"rotation_bias": float("nan")}]
)
def test_senseless_models_are_refused(values: dict[str, float]) -> None:
    with pytest.raises(ValidationError):
        DriftModel(**values)
