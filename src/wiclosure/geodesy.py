"""Latitude, longitude and height as local metres east, north and up, and back (WGS 84, through Earth-fixed axes).

Torge and Mueller, "Geodesy", 2012, section 4.1.  Angles here are degrees, as receivers and maps have them.
"""

from __future__ import annotations

import numpy as np

from wiclosure.arrays import FloatArray

SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
_E2 = FLATTENING * (2.0 - FLATTENING)
_ROUNDS = 8  # of the inverse's fixed point, which gains two digits each


def earth_fixed(geodetic: FloatArray) -> FloatArray:
    """`(N, 3)` metres in axes that turn with the Earth, of latitude and longitude (degrees) and height (m)."""
    latitude, longitude, height = np.radians(geodetic[:, 0]), np.radians(geodetic[:, 1]), geodetic[:, 2]
    across = SEMI_MAJOR_M / np.sqrt(1.0 - _E2 * np.sin(latitude) ** 2)
    radius = (across + height) * np.cos(latitude)
    z = (across * (1.0 - _E2) + height) * np.sin(latitude)
    return np.stack([radius * np.cos(longitude), radius * np.sin(longitude), z], axis=1)


def geodetic_of(position: FloatArray) -> FloatArray:
    """Latitude and longitude (degrees) and height (m) of Earth-fixed positions `(N, 3)`; inverse of `earth_fixed`."""
    x, y, z = position.T
    radius, latitude = np.hypot(x, y), np.arctan2(z, np.hypot(x, y) * (1.0 - _E2))
    for _ in range(_ROUNDS):
        across = SEMI_MAJOR_M / np.sqrt(1.0 - _E2 * np.sin(latitude) ** 2)
        latitude = np.arctan2(z + _E2 * across * np.sin(latitude), radius)
    across = SEMI_MAJOR_M / np.sqrt(1.0 - _E2 * np.sin(latitude) ** 2)
    height = radius * np.cos(latitude) + z * np.sin(latitude) - across * (1.0 - _E2 * np.sin(latitude) ** 2)
    return np.stack([np.degrees(latitude), np.degrees(np.arctan2(y, x)), height], axis=1)


def enu_of(geodetic: FloatArray, origin: FloatArray) -> FloatArray:
    """Metres east, north and up `(N, 3)` of an origin `(3,)`, of latitudes, longitudes (degrees) and heights (m)."""
    return (earth_fixed(geodetic) - earth_fixed(origin[None])) @ _axes(origin)


def geodetic_at(position_enu: FloatArray, origin: FloatArray) -> FloatArray:
    """Latitudes, longitudes (degrees) and heights (m) `(N, 3)` of local positions; inverse of `enu_of`."""
    return geodetic_of(position_enu @ _axes(origin).T + earth_fixed(origin[None]))


def _axes(origin: FloatArray) -> FloatArray:
    """East, north and up of the origin as columns `(3, 3)`, in Earth-fixed axes."""
    latitude, longitude = np.radians(origin[:2])
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    return np.array(
        [
            [-sin_lon, -sin_lat * cos_lon, cos_lat * cos_lon],
            [cos_lon, -sin_lat * sin_lon, cos_lat * sin_lon],
            [0.0, cos_lat, sin_lat],
        ]
    )
