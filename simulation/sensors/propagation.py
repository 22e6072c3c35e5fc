"""Which ways radio waves take: straight, through walls, and mirrored by walls."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from wiclosure.simulation.world.scene import Reflector, Scene
from wiclosure.types import FloatArray, IntArray


class Reflections(NamedTuple):
    """Mirrored paths of many transmissions, one row per path.

    Args:
        transmission: `(R,)` index of the transmission.
        virtual_m: `(R, 3)` where the transmitter seems to be: its mirror image.
    """

    transmission: IntArray
    virtual_m: FloatArray


class Propagation(Protocol):
    """What lies between antennas."""

    def blocked(self, receiver_m: FloatArray, transmitter_m: FloatArray) -> NDArray[np.bool_]:
        """Whether something solid lies between the antennas at `(N, 3)` and `(N, 3)`."""
        ...

    def reflections(self, receiver_m: FloatArray, transmitter_m: FloatArray) -> Reflections:
        """All paths with one mirror reflection."""
        ...


class Unobstructed:
    """Nothing in between, nothing that mirrors."""

    def blocked(self, receiver_m: FloatArray, transmitter_m: FloatArray) -> NDArray[np.bool_]:
        """See `Propagation`."""
        del transmitter_m
        return np.zeros(len(receiver_m), bool)

    def reflections(self, receiver_m: FloatArray, transmitter_m: FloatArray) -> Reflections:
        """See `Propagation`."""
        del receiver_m, transmitter_m
        return Reflections(np.zeros(0, np.int64), np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class InScene:
    """Walls of a scene block and mirror."""

    scene: Scene

    def blocked(self, receiver_m: FloatArray, transmitter_m: FloatArray) -> NDArray[np.bool_]:
        """See `Propagation`."""
        return self.scene.obstacles(receiver_m, transmitter_m) > 0

    def reflections(self, receiver_m: FloatArray, transmitter_m: FloatArray) -> Reflections:
        """See `Propagation`; both legs of a path must be free."""
        walls = self.scene.reflectors
        if not walls or len(receiver_m) == 0:
            return Unobstructed().reflections(receiver_m, transmitter_m)
        # One wall after another over all transmissions: memory stays that of the transmissions.
        found = [_mirrored(wall, receiver_m, transmitter_m) for wall in walls]
        transmission = np.concatenate([rows for rows, _, _ in found])
        virtual = np.concatenate([image for _, image, _ in found])
        at_wall = np.concatenate([point for _, _, point in found])
        receiver, transmitter = receiver_m[transmission], transmitter_m[transmission]
        free = (self.scene.obstacles(receiver, at_wall) == 0) & (self.scene.obstacles(transmitter, at_wall) == 0)
        return Reflections(transmission[free], virtual[free])


def mirror(wall: Reflector, points_m: FloatArray) -> FloatArray:
    """Mirror images `(N, 3)` of the points `(N, 3)` in the plane of the wall."""
    normal = _normal(wall)
    offset = (points_m[:, :2] - wall.start_m) @ normal
    image = points_m.copy()
    image[:, :2] -= 2 * offset[:, None] * normal
    return image


def _normal(wall: Reflector) -> FloatArray:
    along = (wall.end_m - wall.start_m) / np.linalg.norm(wall.end_m - wall.start_m)
    return np.array([along[1], -along[0]])


def _mirrored(
    wall: Reflector, receiver_m: FloatArray, transmitter_m: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Transmissions `(R,)` that the wall mirrors, the transmitters' images and the points on the wall, `(R, 3)`."""
    normal = _normal(wall)
    side_receiver = (receiver_m[:, :2] - wall.start_m) @ normal
    side_transmitter = (transmitter_m[:, :2] - wall.start_m) @ normal
    rows = np.flatnonzero(side_receiver * side_transmitter > 0)
    image, receiver = mirror(wall, transmitter_m[rows]), receiver_m[rows]
    share = side_receiver[rows] / (side_receiver[rows] + side_transmitter[rows])
    at_wall = receiver + share[:, None] * (image - receiver)
    length = np.linalg.norm(wall.end_m - wall.start_m)
    along = (at_wall[:, :2] - wall.start_m) @ (wall.end_m - wall.start_m) / length
    inside = (along >= 0) & (along <= length) & (at_wall[:, 2] >= wall.low_m) & (at_wall[:, 2] <= wall.high_m)
    # A hair in front of the wall, so that the wall itself does not block.
    at_wall[:, :2] += 0.02 * np.sign(side_receiver[rows])[:, None] * normal
    return rows[inside], image[inside], at_wall[inside]
