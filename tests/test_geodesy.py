"""Latitudes and longitudes as local metres, and back."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.geodesy import FLATTENING, SEMI_MAJOR_M, earth_fixed, enu_of, geodetic_at, geodetic_of

LATITUDE, LONGITUDE = st.floats(-89.9, 89.9), st.floats(-179.9, 179.9)


def test_known_points_of_the_ellipsoid():
    points = earth_fixed(np.array([[0.0, 0.0, 0.0], [0.0, 90.0, 10.0], [90.0, 0.0, 0.0], [-90.0, 0.0, 5.0]]))
    b = SEMI_MAJOR_M * (1 - FLATTENING)
    expected = [[SEMI_MAJOR_M, 0, 0], [0, SEMI_MAJOR_M + 10, 0], [0, 0, b], [0, 0, -b - 5]]
    np.testing.assert_allclose(points, expected, atol=1e-6)


@given(LATITUDE, LONGITUDE, st.floats(-500.0, 9000.0))
def test_there_and_back(latitude, longitude, height):
    there = np.array([[latitude, longitude, height]])
    back = geodetic_of(earth_fixed(there))
    np.testing.assert_allclose(back, there, atol=1e-6)


@given(LATITUDE, LONGITUDE, st.integers(0, 2**31))
def test_local_metres_and_back(latitude, longitude, seed):
    origin = np.array([latitude, longitude, 100.0])
    local = np.random.default_rng(seed).normal(0, 1000.0, (5, 3))
    np.testing.assert_allclose(enu_of(geodetic_at(local, origin), origin), local, atol=1e-5)


def test_a_second_of_latitude_is_31_metres_north():
    origin = np.array([49.0, 8.4, 110.0])
    east, north, up = enu_of(origin[None] + [1 / 3600, 0, 0], origin)[0]
    assert abs(north - 30.9) < 0.1
    assert abs(east) < 1e-6
    assert abs(up) < 1e-3
    east, north, up = enu_of(origin[None] + [0, 0, 7.0], origin)[0]
    np.testing.assert_allclose([east, north, up], [0, 0, 7], atol=1e-6)
