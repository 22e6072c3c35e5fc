"""What robots know of the Earth: which way is up, and where on it they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from wiclosure.arrays import FloatArray, IntArray
from wiclosure.errors import InputError


@dataclass(frozen=True, eq=False)
class UpDirections:
    """Directions against gravity at some keyframes of one robot.

    Args:
        index: `(M,)` keyframes.
        up_body: `(M, 3)` unit vectors in the body's axes.
        sigma_rad: `(M,)` standard deviation of each of the two angles.

    Raises:
        InputError: shapes that do not belong together, or vectors that are not of length 1.
    """

    index: IntArray
    up_body: FloatArray
    sigma_rad: FloatArray

    def __post_init__(self) -> None:
        count = len(self.index)
        if self.up_body.shape != (count, 3) or self.sigma_rad.shape != (count,):
            raise InputError(
                f"directions up: {count} keyframes, directions of shape {self.up_body.shape}, sigmas of shape"
                f" {self.sigma_rad.shape}; expected one each"
            )
        if not (np.abs(np.linalg.norm(self.up_body, axis=1) - 1.0) < 1e-6).all() or not (self.sigma_rad > 0).all():
            raise InputError("directions up: vectors must be of length 1, and sigmas positive")

    def __len__(self) -> int:
        return len(self.index)

    def after(self, count: int) -> UpDirections:
        """Without the first so many."""
        return UpDirections(self.index[count:], self.up_body[count:], self.sigma_rad[count:])

    def angles_off(self, R_world_body: FloatArray) -> FloatArray:
        """Angles `(M,)`, rad, between z of the world and up, for all keyframes' rotations `(N, 3, 3)`."""
        up_world = np.einsum("mij,mj->mi", R_world_body[self.index], self.up_body)
        return np.asarray(np.arctan2(np.linalg.norm(up_world[:, :2], axis=1), up_world[:, 2]))


@dataclass(frozen=True, eq=False)
class GnssLog:
    """Positions on the Earth as a receiver gave them.

    Args:
        stamps_ns: `(N,)` int64, strictly increasing.
        geodetic: `(N, 3)` latitude and longitude in degrees, height over the ellipsoid in metres.
        sigma_enu: `(N, 3)` standard deviations east, north and up, m.

    Raises:
        InputError: shapes that do not belong together, or no position on the Earth.
    """

    stamps_ns: IntArray
    geodetic: FloatArray
    sigma_enu: FloatArray

    def __post_init__(self) -> None:
        count = len(self.stamps_ns)
        if self.geodetic.shape != (count, 3) or self.sigma_enu.shape != (count, 3):
            raise InputError(
                f"GNSS: {count} stamps, positions of shape {self.geodetic.shape}, sigmas of shape"
                f" {self.sigma_enu.shape}; expected (N, 3)"
            )
        off = (np.abs(self.geodetic[:, 0]) > 90.0) | (np.abs(self.geodetic[:, 1]) > 360.0)
        if off.any():
            row = int(np.argmax(off))
            raise InputError(
                f"GNSS: fix {row} is at latitude {self.geodetic[row, 0]}, longitude {self.geodetic[row, 1]}; expected"
                " degrees, latitude first"
            )

    def __len__(self) -> int:
        return len(self.stamps_ns)


@dataclass(frozen=True, eq=False)
class PositionFixes:
    """Positions of one robot's antenna on the Earth.

    Args:
        index: `(M,)` keyframes, the nearest in time.
        position_enu: `(M, 3)` east, north, up of the team's origin, m.
        sigma_enu: `(M, 3)` standard deviations, m.
        antenna_body: `(M, 3)` the antenna in the keyframe's axes at the time of the fix, m.
    """

    index: IntArray
    position_enu: FloatArray
    sigma_enu: FloatArray
    antenna_body: FloatArray

    def __len__(self) -> int:
        return len(self.index)

    def antennas(self, T_world_body: FloatArray) -> FloatArray:
        """The antenna `(M, 3)` in the world, for all keyframes' poses `(N, 4, 4)`."""
        T = T_world_body[self.index]
        return np.asarray(np.einsum("mij,mj->mi", T[:, :3, :3], self.antenna_body) + T[:, :3, 3])

    def after(self, count: int) -> PositionFixes:
        """Without the first so many."""
        rows = slice(count, None)
        return PositionFixes(self.index[rows], self.position_enu[rows], self.sigma_enu[rows], self.antenna_body[rows])


@dataclass(frozen=True, eq=False)
class EarthMeasurements:
    """All that is known of the Earth, by robot; robots may have one, both or nothing.

    Args:
        up: directions against gravity, where z of the robot's odometry frame points up already.
        fixes: positions.
    """

    up: Mapping[str, UpDirections] = field(default_factory=dict)
    fixes: Mapping[str, PositionFixes] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return any(map(len, self.up.values())) or any(map(len, self.fixes.values()))
