"""Where the robots of `systematic.py` go, how their odometry drifts, and what they hear of each other.

Five worlds: a straight aisle, a site with walls, two robots that roam, cars on streets at 8 to 10 m/s, and recorded
KITTI odometry.  The radio model is not the simulator's: ranges with 0.3 m noise, bearings with 8 degrees, up to three
false paths, the direct one missing in 15 %.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import kitti
import numpy as np

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import AoaPath, FloatArray, Heading, Trajectory, WirelessLog, WirelessMeasurement

STEP_M, STEP_NS = 0.5, 500_000_000
RANGE_SIGMA_M, AOA_SIGMA_RAD = 0.3, np.radians(8.0)
START_NS = 1_700_000_000 * 10**9


@dataclass(frozen=True, eq=False)
class World:
    """Where robots go, and what stands in the way of radio.

    Args:
        truth: true paths by robot, one frame, equal stamps.
        walls: `(W, 4)` segments x0, y0, x1, y1 that block the line of sight.
        every: a measurement every so many poses.
        odometry: as recorded; None where it is simulated.
        reach_m: m, how far the radio is heard.
    """

    truth: dict[str, Trajectory]
    walls: FloatArray
    every: int = 8
    odometry: dict[str, Trajectory] | None = None
    reach_m: float = 150.0


@dataclass(frozen=True)
class Hearing:
    """How the radio is heard.

    Args:
        reciprocal: both robots listen.
        headings: compasses on both robots.
        bias_m: by place, of ranges through walls.
        mirror: a wall `y = mirror` whose image of the transmitter is heard besides the direct path.
        mirror_only: share of measurements of which only the image is heard.
    """

    reciprocal: bool = False
    headings: bool = False
    bias_m: float = 0.0
    mirror: float | None = None
    mirror_only: float = 0.0


def along(robot: str, corners: FloatArray, rng: np.random.Generator, step_m: float = STEP_M) -> Trajectory:
    """A robot that drives from corner to corner in smooth turns, `step_m` and half a second a pose."""
    legs = np.linalg.norm(np.diff(corners, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(legs)])
    s = np.arange(0.0, way[-1], step_m)
    x, y = (np.interp(s, way, corners[:, k]) for k in range(2))
    kernel = np.ones(7) / 7
    x, y = (np.convolve(np.pad(c, 3, mode="edge"), kernel, mode="valid") for c in (x, y))
    sway = 0.15 * np.sin(s / rng.uniform(4, 9) + rng.uniform(0, 6))
    yaw = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    positions = np.column_stack([x - sway * np.sin(yaw), y + sway * np.cos(yaw), np.zeros(len(s))])
    return Trajectory(robot, START_NS + np.arange(len(s)) * STEP_NS, se3.from_yaw(yaw, positions))


def aisle(robots: int, rng: np.random.Generator) -> World:
    """A straight aisle 4 m wide: the robots meet or follow each other along it."""
    names, length = ("a", "b", "c")[:robots], rng.uniform(60, 90)
    truth = {}
    for k, name in enumerate(names):
        start, end = (0.0, length) if k == 0 or rng.uniform() < 0.5 else (length + 5, 5.0)
        side = rng.uniform(-1, 1)
        truth[name] = along(name, np.array([[start + 8 * k, side], [end + 8 * k, side + rng.uniform(-0.3, 0.3)]]), rng)
    walls = np.array([[-20.0, 2.5, length + 30, 2.5], [-20.0, -2.5, length + 30, -2.5]])
    return World(_cut(truth), walls)


def site(robots: int, rng: np.random.Generator) -> World:
    """Blocks of 25 by 18 m with lanes between: each robot drives around two of them."""
    names = ("a", "b", "c")[:robots]
    truth = {}
    for k, name in enumerate(names):
        x, y = rng.uniform(-3, 3, 2) + np.array([6.0, 3.0]) * k
        loop = np.array([[x, y], [x + 32, y], [x + 32, y + 24], [x, y + 24], [x, y + 4], [x + 60, y + 4]])
        loop = loop if rng.uniform() < 0.5 else loop[::-1]
        truth[name] = along(name, loop, rng)
    block = np.array([[0, 0, 20, 0], [20, 0, 20, 12], [20, 12, 0, 12], [0, 12, 0, 0]], float)
    offset = np.array([8.0, 8.0, 8.0, 8.0])
    walls = np.concatenate([block + offset, block + offset + [36, 0, 36, 0]])
    return World(_cut(truth), walls)


def roaming(robots: int, rng: np.random.Generator) -> World:
    """Open ground of 50 m: the robots wander."""
    names = ("a", "b", "c")[:robots]
    truth = {}
    for name in names:
        corners = [rng.uniform(0, 50, 2)]
        for _ in range(6):
            turn, reach = rng.uniform(-np.pi, np.pi), rng.uniform(10, 25)
            corners.append(np.clip(corners[-1] + reach * np.array([np.cos(turn), np.sin(turn)]), 0, 50))
        truth[name] = along(name, np.array(corners), rng)
    return World(_cut(truth), np.zeros((0, 4)))


def street(robots: int, rng: np.random.Generator) -> World:
    """Cars at 8 to 10 m/s around blocks of 80 m: they follow, meet, and turn off."""
    names, block, truth = ("a", "b", "c")[:robots], 80.0, {}
    for name in names:
        corner, heading = rng.integers(0, 2, 2) * block, rng.integers(4)
        corners = [corner]
        for _ in range(4):
            corners.append(corners[-1] + block * np.array([(1, 0), (0, 1), (-1, 0), (0, -1)][heading]))
            heading = (heading + rng.choice([-1, 0, 0, 1])) % 4
        truth[name] = along(name, np.array(corners) + rng.uniform(-2, 2, 2), rng, step_m=rng.uniform(4, 5))
    return World(_cut(truth), np.zeros((0, 4)), every=3)


@functools.cache
def _recorded(sequence: str) -> kitti.Team:
    team = kitti.thirds(sequence)
    rows = np.arange(0, len(team.truth["alpha"]), 5)
    return kitti.Team(*({n: t.subset(rows) for n, t in each.items()} for each in (team.truth, team.odometry)))


def recorded(robots: int, rng: np.random.Generator) -> World:
    """A minute of KITTI's sequences 00, 05 and 08, cut in thirds, in which the robots are near each other."""
    team = _recorded(str(rng.choice(["00", "05", "08"])))
    chosen = sorted(rng.choice(kitti.ROBOTS, robots, replace=False))
    places = np.array([team.truth[name].positions for name in chosen])
    apart = np.linalg.norm(places - places.mean(axis=0), axis=2).max(axis=0)
    size = min(120, len(apart))
    window = np.convolve(apart, np.ones(size) / size, mode="valid")
    start = int(rng.choice(np.argsort(window)[: max(1, len(window) // 4)]))
    names, rows = dict(zip(chosen, ("a", "b", "c"), strict=False)), np.arange(start, start + size)
    truth, odometry = (
        {new: Trajectory(new, START_NS + of[old].stamps_ns[rows], of[old].poses[rows]) for old, new in names.items()}
        for of in (team.truth, team.odometry)
    )
    return World(truth, np.zeros((0, 4)), every=3, odometry=odometry)


def _cut(truth: dict[str, Trajectory]) -> dict[str, Trajectory]:
    count = min(len(t) for t in truth.values())
    return {name: t.subset(np.arange(count)) for name, t in truth.items()}


WORLDS: Mapping[str, Callable[[int, np.random.Generator], World]] = {
    "aisle": aisle,
    "site": site,
    "roaming": roaming,
    "street": street,
    "kitti": recorded,
}


def listen(world: World, hearing: Hearing, rng: np.random.Generator) -> WirelessLog:
    """What the robots hear of each other."""
    names = list(world.truth)
    measurements = []
    for i, receiver in enumerate(names):
        for j, transmitter in enumerate(names):
            if i < j or (i > j and hearing.reciprocal):
                measurements += _link(world, world.truth[receiver], world.truth[transmitter], hearing, rng)
    headings = []
    if hearing.headings:
        for t in world.truth.values():
            read = se3.yaw(t.poses) + rng.normal(0, 0.05, len(t))
            headings += [Heading(int(s), t.robot, float(h), 0.05) for s, h in zip(t.stamps_ns, read, strict=True)]
    return WirelessLog(
        tuple(sorted(measurements, key=lambda m: m.stamp_ns)), tuple(sorted(headings, key=lambda h: h.stamp_ns))
    )


def _link(
    world: World, receiver: Trajectory, transmitter: Trajectory, hearing: Hearing, rng: np.random.Generator
) -> list[WirelessMeasurement]:
    rows = np.arange(rng.integers(world.every), len(receiver), world.every)
    heard = []
    for row in rows:
        here, there = receiver.poses[row], transmitter.positions[row]
        seen = se3.transform(se3.inverse(here), there)
        distance = float(np.linalg.norm(seen))
        if distance > world.reach_m:
            continue
        blocked = _blocked(here[:2, 3], there[:2], world.walls)
        bias = hearing.bias_m * rng.uniform(0.5, 1.5) if blocked else 0.0
        azimuths = list(rng.uniform(-np.pi, np.pi, rng.integers(0, 4)))
        image_only = hearing.mirror is not None and rng.uniform() < hearing.mirror_only
        if not image_only and rng.uniform() > (0.4 if blocked else 0.15):
            azimuths.append(np.arctan2(seen[1], seen[0]) + rng.normal(0, AOA_SIGMA_RAD))
        if hearing.mirror is not None:
            image = there * [1, -1, 1] + [0, 2 * hearing.mirror, 0]
            reflected = se3.transform(se3.inverse(here), image)
            azimuths.append(np.arctan2(reflected[1], reflected[0]) + rng.normal(0, AOA_SIGMA_RAD))
            if image_only:
                distance = float(np.linalg.norm(reflected))
        rng.shuffle(azimuths)
        weights = rng.uniform(0.3, 1.0, len(azimuths))
        paths = tuple(
            AoaPath(float((a + np.pi) % (2 * np.pi) - np.pi), AOA_SIGMA_RAD, float(w))
            for a, w in zip(azimuths, weights, strict=True)
        )
        ranged = abs(distance + bias + rng.normal(0, RANGE_SIGMA_M))
        heard.append(
            WirelessMeasurement(
                int(receiver.stamps_ns[row]), receiver.robot, transmitter.robot, ranged, RANGE_SIGMA_M, paths
            )
        )
    return heard


def _blocked(p: FloatArray, q: FloatArray, walls: FloatArray) -> bool:
    if len(walls) == 0:
        return False
    r, start, step = q - p, walls[:, :2] - p, walls[:, 2:] - walls[:, :2]
    cross = r[0] * step[:, 1] - r[1] * step[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (start[:, 0] * step[:, 1] - start[:, 1] * step[:, 0]) / cross
        u = (start[:, 0] * r[1] - start[:, 1] * r[0]) / cross
    return bool(((cross != 0) & (t > 0) & (t < 1) & (u > 0) & (u < 1)).any())


def drifted(truth: Trajectory, rng: np.random.Generator, T_odom_first: FloatArray | None = None) -> Trajectory:
    """Odometry in a frame of its own, random unless its first pose is given; drift as the default model has it."""
    drift = DriftModel()
    steps = se3.between(truth.poses[:-1], truth.poses[1:])
    metres, turn = np.linalg.norm(steps[:, :3, 3], axis=1), se3.rotation_angle(steps)
    sigma = np.zeros((len(steps), 6))
    sigma[:, 2] = np.sqrt(drift.rotation_walk**2 * metres + drift.rotation_walk_turning**2 * turn)
    sigma[:, 3:5] = (drift.translation_walk * np.sqrt(metres))[:, None]
    if T_odom_first is None:
        T_odom_first = se3.from_yaw(rng.uniform(-np.pi, np.pi), np.array([*rng.uniform(-20, 20, 2), 0.0]))
    poses = [T_odom_first]
    for step in steps @ se3.exp(sigma * rng.normal(size=sigma.shape)):
        poses.append(poses[-1] @ step)
    return Trajectory(truth.robot, truth.stamps_ns, np.array(poses))


def wrap(angle: float) -> float:
    """Between -pi and pi."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)
