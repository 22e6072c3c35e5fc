from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.99e-4, 1.01e-4, 0.1, 1.5, 2.6, 2.9, 3.1, np.pi - 1e-6])
def test_log_is_the_inverse_of_exp_below_pi(angle: float) -> None:
    rng = np.random.default_rng(0)
    axis = rng.normal(size=(200, 3))
    rotation = angle * axis / np.linalg.norm(axis, axis=1, keepdims=True)
    xi = np.concatenate([rotation, rng.normal(0, 10.0, (200, 3))], axis=1)
    np.testing.assert_allclose(se3.log(se3.exp(xi)), xi, atol=1e-9)


def test_log_of_half_turns_is_one_of_the_two() -> None:
    half_turns = se3.from_yaw(np.pi, np.array([[1.0, 2.0, 3.0], [0.0, 0.0, 0.0], [4.0, 5.0, 6.0]]))
    half_turns[2, :3, :3] = np.diag([-1.0, -1.0, 1.0])  # R - R^T is exactly zero
    np.testing.assert_allclose(se3.exp(se3.log(half_turns)), half_turns, atol=1e-9)


def test_log_keeps_leading_dimensions() -> None:
    assert se3.log(np.eye(4)).shape == (6,)
    assert se3.log(np.zeros((0, 4, 4))).shape == (0, 6)
    assert se3.log(np.broadcast_to(np.eye(4), (2, 3, 4, 4))).shape == (2, 3, 6)


def test_wrapped_angles_are_the_same_angles_within_half_a_turn() -> None:
    angle = np.array([0.0, 3.0, 3.5, -3.5, 2 * np.pi, 7.0, -700.0])
    wrapped = se3.wrap_angle(angle)
    assert (np.abs(wrapped) <= np.pi).all()
    np.testing.assert_allclose(np.exp(1j * wrapped), np.exp(1j * angle), atol=1e-9)
    np.testing.assert_allclose(wrapped[:3], [0.0, 3.0, 3.5 - 2 * np.pi])
