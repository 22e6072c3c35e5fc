"""What is known of the Earth: shapes and values are checked when it is made."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure.errors import InputError
from wiclosure.types import EarthMeasurements, GnssLog, PositionFixes, UpDirections

ONE = np.array([0])


def test_angles_between_up_and_the_world():
    R = Rotation.from_rotvec(np.radians([[0, 0, 0], [10, 0, 0], [180, 0, 0]])).as_matrix()
    up = UpDirections(np.arange(3), np.tile([0.0, 0.0, 1.0], (3, 1)), np.full(3, 0.01))
    np.testing.assert_allclose(np.degrees(up.angles_off(R)), [0, 10, 180], atol=1e-6)
    assert up.after(2).index.tolist() == [2]


def test_antennas_stand_aside():
    from wiclosure import se3

    T = se3.from_yaw(np.pi / 2, np.array([5.0, 0.0, 0.0]))
    fixes = PositionFixes(ONE, np.zeros((1, 3)), np.ones((1, 3)), np.array([[1.0, 0.0, 2.0]]))
    np.testing.assert_allclose(fixes.antennas(T[None]), [[5, 1, 2]], atol=1e-12)


@pytest.mark.parametrize(
    ("up", "sigma"),
    [(np.ones((1, 3)), np.ones(1)), (np.array([[0, 0, 1.0]]), np.zeros(1)), (np.zeros((2, 3)), np.ones(2))],
)
def test_directions_that_are_none(up, sigma):
    with pytest.raises(InputError, match="directions up"):
        UpDirections(ONE, up, sigma)


def test_latitude_and_longitude_the_wrong_way_round():
    with pytest.raises(InputError, match="latitude first"):
        GnssLog(ONE, np.array([[120.0, 30.0, 0.0]]), np.ones((1, 3)))
    with pytest.raises(InputError, match=r"expected \(N, 3\)"):
        GnssLog(ONE, np.zeros((1, 2)), np.ones((1, 3)))


def test_nothing_is_false():
    assert not EarthMeasurements()
    assert EarthMeasurements({"a": UpDirections(ONE, np.array([[0, 0, 1.0]]), np.ones(1))})
