"""Choices of axes: all 48, and the one that was made is found."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure.frontends.inertial.axes import CHOICES, best_choice, in_words, left_handed, rechosen
from wiclosure.frontends.inertial.turning import TurningRates
from wiclosure.frontends.inertial.windows import windows_along
from wiclosure.types import ImuLog


def test_there_are_48_and_the_first_changes_nothing():
    assert len(np.unique(CHOICES.reshape(48, 9), axis=0)) == 48
    np.testing.assert_array_equal(CHOICES[0], np.eye(3))
    np.testing.assert_allclose(CHOICES @ np.swapaxes(CHOICES, 1, 2), np.broadcast_to(np.eye(3), (48, 3, 3)))
    assert in_words(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])) == "-y, +x, +z"


@pytest.mark.parametrize("number", range(0, 48, 5))
def test_a_choice_is_found_back(number, imu, odometry):
    made = ImuLog(imu.stamps_ns, imu.acceleration @ CHOICES[number], imu.turning_rate)
    windows = windows_along(made, odometry)
    found = best_choice(windows, np.eye(3))
    np.testing.assert_array_equal(found, CHOICES[number])
    np.testing.assert_allclose(
        rechosen(windows, found).gravity(np.eye(3)), windows_along(imu, odometry).gravity(np.eye(3)), atol=1e-9
    )


def test_mirrors_are_told_from_rotations(odometry, imu):
    for choice in CHOICES:
        made = ImuLog(imu.stamps_ns, imu.acceleration, imu.turning_rate @ choice)
        assert left_handed(TurningRates.of(made, odometry), 0.5) == (np.linalg.det(choice) < 0)
