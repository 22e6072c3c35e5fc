"""Streets lined with houses: lots along a centre line, alike or unique."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from wiclosure import se3
from wiclosure.simulation.world.mesh import Mesh, box, bush, car, gable, join, pole, tree
from wiclosure.simulation.world.motion import GroundPath
from wiclosure.simulation.world.scene import Footprint, SceneBuilder
from wiclosure.types import FloatArray

LOT_WIDTH_M = 17.0
KERB_M = 6.5
"""From the centre line to the front of a lot."""

_LOT_DEPTH_M = 16.0
_CLEAR_OF_ROAD_M = 6.0
_CLEAR_OF_LOTS_M = 3.0
_GAPS = 0.1


@dataclass(slots=True)
class Lot:
    """What stands on one lot; x along the street, y away from it, the origin in the middle of its front."""

    house: Mesh
    footprint: Footprint
    house_at: tuple[float, float, float]
    solid: list[tuple[Mesh, float, float, float]] = field(default_factory=list)
    slight: list[tuple[Mesh, float, float, float]] = field(default_factory=list)


def make_lot(rng: np.random.Generator) -> Lot:
    """A lot of its own: house, extension, hedge, trees, a lamp, a parked car."""
    size = Footprint(rng.uniform(8.5, 13.0), rng.uniform(6.0, 9.0), rng.uniform(3.0, 7.0))
    setback = rng.uniform(1.5, 5.0)
    place = (rng.uniform(-1.5, 1.5), setback + size.width_m / 2, rng.choice([0.0, rng.uniform(-0.15, 0.15)]))
    lot = Lot(_house(rng, size), size, place)
    if rng.random() < 0.8:
        lot.solid.append((box(rng.uniform(6, 14), 0.5, rng.uniform(0.8, 2.2)), rng.uniform(-3, 3), 0.4, 0.0))
    if rng.random() < 0.7:
        length, height = rng.uniform(3.8, 5.2), rng.uniform(1.4, 2.0)
        lot.solid.append((car(length, 1.8, height), rng.uniform(-6, 6), -1.6, rng.choice([0.0, np.pi])))
    if rng.random() < 0.5:
        shed = box(rng.uniform(2.5, 4), rng.uniform(2.5, 5), rng.uniform(2.2, 3.0))
        lot.solid.append((shed, rng.choice([-6.3, 6.3]), rng.uniform(4, 9), 0.0))
    _plants(lot, rng)
    if rng.random() < 0.5:
        lot.slight.append((pole(rng.uniform(4.5, 8), 0.09, 1.0), rng.uniform(-8, 8), -0.3, -np.pi / 2))
    return lot


def _plants(lot: Lot, rng: np.random.Generator) -> None:
    """Trees beside the house and behind it, bushes along the street: half of what recorded scans see is green."""
    for _ in range(rng.integers(1, 4)):
        height = rng.uniform(4.0, 11.0)
        side = rng.choice([-1.0, 1.0])
        lot.slight.append(
            (tree(rng, height, 0.3 * height, 60), side * rng.uniform(6.5, 8.3), rng.uniform(1.5, 12), 0.0)
        )
    for x_m in rng.uniform(-8, 8, rng.integers(2, 5)):
        height = rng.uniform(5.0, 12.0)
        lot.slight.append((tree(rng, height, 0.32 * height, 40), x_m, rng.uniform(13, 20), 0.0))
    for x_m in rng.uniform(-8, 8, rng.integers(4, 10)):
        height = rng.uniform(0.8, 3.0)
        lot.slight.append((bush(rng, height, 0.5 * height), x_m, 0.5 * height + rng.uniform(0.3, 1.5), 0.0))


def _house(rng: np.random.Generator, size: Footprint) -> Mesh:
    """Walls, a roof, a chimney and a part that juts out."""
    parts = [box(size.length_m, size.width_m, size.height_m)]
    if rng.random() < 0.75:
        along_street = rng.random() < 0.6
        length, width = (size.length_m, size.width_m) if along_street else (size.width_m, size.length_m)
        roof = gable(length + 0.7, width + 0.7, rng.uniform(1.5, 3.2))
        parts.append(roof.at(0, 0, size.height_m, 0.0 if along_street else np.pi / 2))
        parts.append(box(0.7, 0.7, 3.0).at(rng.uniform(-2, 2), rng.uniform(-1, 1), size.height_m))
    depth = rng.uniform(0.6, 2.0)
    jut = box(rng.uniform(1.5, 4.0), depth, rng.uniform(2.2, size.height_m))
    parts.append(jut.at(rng.uniform(-0.3, 0.3) * size.length_m, -(size.width_m + depth) / 2))
    return join(parts)


def line_with_lots(builder: SceneBuilder, streets: list[GroundPath], rng: np.random.Generator, aliasing: float) -> int:
    """Places lots on both sides of the streets wherever there is room; returns how many.

    Args:
        builder: takes the lots.
        streets: centre lines; no lot reaches onto any of them.
        rng: chooses the lots.
        aliasing: probability that a lot is a copy of the common one.
    """
    common = make_lot(np.random.default_rng(8))
    places = np.concatenate([_lot_places(street) for street in streets])
    samples = _samples(places)
    on_road = _distance_to_roads(samples, streets) < _CLEAR_OF_ROAD_M
    taken = np.full((1, 2), np.inf)
    lots = 0
    for place, area, blocked in zip(places, samples, on_road, strict=True):
        # Drawn for every place, so that one lot more or less does not change all others.
        unique, gap, own = rng.random() >= aliasing, rng.random() < _GAPS, rng.spawn(1)[0]
        if blocked or (gap and unique) or _gap(area, taken) < _CLEAR_OF_LOTS_M:
            continue
        _place(builder, make_lot(own) if unique else common, *place.tolist())
        taken = np.vstack([taken, area])
        lots += 1
    return lots


def _lot_places(street: GroundPath) -> FloatArray:
    """`(L, 3)` x, y and yaw of the fronts on both sides of a street, a lot's width apart."""
    at = np.arange(LOT_WIDTH_M / 2, street.length_m, LOT_WIDTH_M)
    x, y, yaw = (np.interp(at, street.s_m, values) for values in (*street.xy_m.T, street.yaw_rad))
    places = [
        np.stack([x - side * KERB_M * np.sin(yaw), y + side * KERB_M * np.cos(yaw), yaw + (side < 0) * np.pi], axis=1)
        for side in (1, -1)
    ]
    return np.concatenate(places)


def _samples(places: FloatArray) -> FloatArray:
    """`(L, 25, 2)` points that spread over each lot."""
    along, away = np.meshgrid(np.linspace(-6.5, 6.5, 5), np.linspace(0.5, _LOT_DEPTH_M - 3, 5))
    points = np.stack([along.ravel(), away.ravel(), np.zeros(25)], axis=1)
    T_world_lot = se3.from_yaw(places[:, 2], np.pad(places[:, :2], ((0, 0), (0, 1))))
    return se3.transform(T_world_lot[:, None], points)[..., :2]


def _distance_to_roads(samples: FloatArray, streets: list[GroundPath]) -> FloatArray:
    """`(L,)` smallest distance of each lot from any centre line."""
    from scipy.spatial import cKDTree

    road = cKDTree(
        np.concatenate([street.xy_m[:: max(1, int(1.0 / np.diff(street.s_m).mean()))] for street in streets])
    )
    return np.asarray(np.reshape(road.query(samples.reshape(-1, 2))[0], samples.shape[:2]).min(axis=1))


def _gap(points: FloatArray, others: FloatArray) -> float:
    """Smallest distance between two sets of points, metres; far ones do not count."""
    near = others[np.abs(others - points.mean(axis=0)).max(axis=1) < 40.0]
    return float(np.sqrt(((points[:, None] - near[None]) ** 2).sum(axis=2).min(initial=1e4)))


def _place(builder: SceneBuilder, lot: Lot, x_m: float, y_m: float, yaw: float) -> None:
    cos, sin = np.cos(yaw), np.sin(yaw)

    def world(x: float, y: float, turn: float) -> tuple[float, float, float]:
        return float(x_m + cos * x - sin * y), float(y_m + sin * x + cos * y), float(yaw + turn)

    builder.building(lot.house, lot.footprint, *world(*lot.house_at))
    for mesh, *where in lot.solid:
        builder.stand(mesh, *world(*where))
    for mesh, *where in lot.slight:
        builder.plant(mesh, *world(*where))
