"""The filter under systematic errors: how often it calls an alignment certain that is wrong.

    python benchmarks/systematic.py [--trials 30] [--faults clocks,mirror] [--worlds aisle,site] [--seed 1]

Five worlds (a straight aisle, a site with walls, two robots that roam, cars on streets at 8 to 10 m/s, and recorded
KITTI odometry), with a radio model of their own: ranges with 0.3 m noise, bearings with 8 degrees, up to three false
paths, the direct one missing in 15 %.  One fault at a time, in the log or in one robot's odometry.  Counted as *certain
and wrong*: the filter calls the alignment certain, it is off by more than 4 m or 25 degrees at the middle of the
meeting, and it either lies beyond its own 3 sigma or loses more than 5 % of the pairs within 35 m.  *Named*: a sentence
of the diagnosis says what the fault is.
"""

from __future__ import annotations

import argparse
import functools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import kitti
import numpy as np

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import (
    AoaPath,
    FilterResult,
    FloatArray,
    Heading,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.filter import WiClosureFilter

NEAR_M, WRONG_M, WRONG_RAD = 35.0, 4.0, np.radians(25.0)
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


@dataclass(frozen=True, eq=False)
class Case:
    """What the filter is given: keyframe odometry and log, and the truth to hold its answer against."""

    truth: dict[str, Trajectory]
    odometry: dict[str, Trajectory]
    log: WirelessLog


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


@dataclass(frozen=True)
class Fault:
    """One systematic error.

    Args:
        name: as in the table.
        goal: most trials of 90 that may be certain and wrong.
        hearing: how the radio is heard.
        spoil: what is done to the case.
        words: any of these in the diagnosis names it; empty where naming is not asked for.
        robots: how many.
    """

    name: str
    goal: int
    hearing: Hearing = Hearing()
    spoil: Callable[[Case, np.random.Generator], Case] = lambda case, _: case
    words: tuple[str, ...] = ()
    robots: int = 2


# Worlds ------------------------------------------------------------------------------------------------------------


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


# Radio -------------------------------------------------------------------------------------------------------------


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


# Odometry and faults -----------------------------------------------------------------------------------------------


def drifted(truth: Trajectory, rng: np.random.Generator) -> Trajectory:
    """Odometry in a frame of its own, with drift as the default model has it."""
    drift = DriftModel()
    steps = se3.between(truth.poses[:-1], truth.poses[1:])
    metres, turn = np.linalg.norm(steps[:, :3, 3], axis=1), se3.rotation_angle(steps)
    sigma = np.zeros((len(steps), 6))
    sigma[:, 2] = np.sqrt(drift.rotation_walk**2 * metres + drift.rotation_walk_turning**2 * turn)
    sigma[:, 3:5] = (drift.translation_walk * np.sqrt(metres))[:, None]
    poses = [se3.from_yaw(rng.uniform(-np.pi, np.pi), np.array([*rng.uniform(-20, 20, 2), 0.0]))]
    for step in steps @ se3.exp(sigma * rng.normal(size=sigma.shape)):
        poses.append(poses[-1] @ step)
    return Trajectory(truth.robot, truth.stamps_ns, np.array(poses))


def each_path(change: Callable[[float], float]) -> Callable[[Case, np.random.Generator], Case]:
    """Azimuths changed."""

    def spoil(case: Case, _: np.random.Generator) -> Case:
        changed = tuple(
            replace(m, paths=tuple(replace(p, azimuth=wrap(change(p.azimuth))) for p in m.paths))
            for m in case.log.measurements
        )
        return replace(case, log=replace(case.log, measurements=changed))

    return spoil


def wrap(angle: float) -> float:
    """Between -pi and pi."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def each(change: Callable[[WirelessMeasurement], WirelessMeasurement]) -> Callable[[Case, np.random.Generator], Case]:
    """Measurements changed."""
    return lambda case, _: replace(
        case, log=replace(case.log, measurements=tuple(change(m) for m in case.log.measurements))
    )


def clocks(seconds: float) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's clock is ahead."""

    def spoil(case: Case, rng: np.random.Generator) -> Case:
        b = case.odometry["b"]
        shift = int(seconds * 1e9) * (1 if rng.uniform() < 0.5 else -1)
        return replace(case, odometry={**case.odometry, "b": replace(b, stamps_ns=b.stamps_ns + shift)})

    return spoil


def scaled(factor: float) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's odometry is too long or too short."""

    def spoil(case: Case, rng: np.random.Generator) -> Case:
        b, by = case.odometry["b"], factor if rng.uniform() < 0.5 else 1 / factor
        poses = b.poses.copy()
        poses[:, :3, 3] = poses[0, :3, 3] + by * (poses[:, :3, 3] - poses[0, :3, 3])
        return replace(case, odometry={**case.odometry, "b": replace(b, poses=poses)})

    return spoil


def jump(metres: float, degrees: float) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's odometry misses a move in the middle third of its way."""

    def spoil(case: Case, rng: np.random.Generator) -> Case:
        b = case.odometry["b"]
        at = int(rng.uniform(0.35, 0.65) * len(b))
        side = rng.uniform(-np.pi, np.pi)
        missed = se3.from_yaw(
            np.radians(degrees) * (1 if rng.uniform() < 0.5 else -1),
            metres * np.array([np.cos(side), np.sin(side), 0.0]),
        )
        poses = b.poses.copy()
        poses[at:] = b.poses[at] @ missed @ se3.inverse(b.poses[at]) @ b.poses[at:]
        return replace(case, odometry={**case.odometry, "b": replace(b, poses=poses)})

    return spoil


def swapped(names: Mapping[str, str]) -> Callable[[Case, np.random.Generator], Case]:
    """Robots' names are mixed up in the log."""
    return each(
        lambda m: replace(
            m, receiver=names.get(m.receiver, m.receiver), transmitter=names.get(m.transmitter, m.transmitter)
        )
    )


def in_axes(axes: FloatArray) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's odometry in other axes: of its frame and of its body."""

    def spoil(case: Case, _: np.random.Generator) -> Case:
        b = case.odometry["b"]
        poses = b.poses.copy()
        poses[:, :3, :3] = axes @ poses[:, :3, :3] @ axes
        poses[:, :3, 3] = poses[:, :3, 3] @ axes
        return replace(case, odometry={**case.odometry, "b": replace(b, poses=poses)})

    return spoil


def compass_off(degrees: float) -> Callable[[Case, np.random.Generator], Case]:
    """Robot b's compass is turned."""

    def spoil(case: Case, _: np.random.Generator) -> Case:
        off = np.radians(degrees)
        headings = tuple(replace(h, heading=wrap(h.heading + off)) if h.robot == "b" else h for h in case.log.headings)
        return replace(case, log=replace(case.log, headings=headings))

    return spoil


FEET = 3.28084
LEFT_HANDED, NED = np.diag([1.0, -1.0, 1.0]), np.diag([1.0, -1.0, -1.0])

FAULTS = (
    Fault("none", 1),
    Fault("nlos bias", 1, Hearing(bias_m=2.0)),
    Fault("reciprocal", 1, Hearing(reciprocal=True)),
    Fault("mirror", 3, Hearing(mirror=6.0)),
    Fault("mirror, direct gone", 15, Hearing(mirror=6.0, mirror_only=0.85)),
    Fault("clocks 0.5 s", 1, spoil=clocks(0.5), words=("clock",)),
    Fault("clocks 2 s", 3, spoil=clocks(2.0), words=("clock",)),
    Fault("scale 3 %", 2, spoil=scaled(1.03)),
    Fault("scale 10 %", 5, spoil=scaled(1.10)),
    Fault("slip 5 m", 3, spoil=jump(5.0, 0.0)),
    Fault("slip 5 m, 30 deg", 3, spoil=jump(5.0, 30.0)),
    Fault("kidnapped 20 m", 3, spoil=jump(20.0, 0.0)),
    Fault("ids swapped", 3, spoil=swapped({"a": "b", "b": "a"})),
    Fault("ids of three swapped", 10, spoil=swapped({"a": "b", "b": "c", "c": "a"}), robots=3),
    Fault("azimuth clockwise", 3, spoil=each_path(lambda a: -a), words=("clockwise",)),
    Fault("clockwise, reciprocal", 3, Hearing(reciprocal=True), each_path(lambda a: -a), ("clockwise",)),
    Fault("azimuth from the left", 3, spoil=each_path(lambda a: a - np.pi / 2), words=("from the left",)),
    Fault("azimuth reversed", 3, spoil=each_path(lambda a: a + np.pi), words=("reversed",)),
    Fault("azimuth +20 deg", 3, spoil=each_path(lambda a: a + np.radians(20)), words=("mounted", "azimuth offset")),
    Fault("azimuth in degrees", 3, spoil=each_path(np.degrees), words=("azimuths",)),
    Fault("odometry y right", 3, spoil=in_axes(LEFT_HANDED), words=("y to the right",)),
    Fault("odometry NED", 3, spoil=in_axes(NED), words=("y to the right",)),
    Fault("ranges in feet", 2, spoil=each(lambda m: replace(m, range_m=(m.range_m or 0.0) * FEET)), words=("feet",)),
    Fault(
        "ranges +3 m",
        2,
        spoil=each(lambda m: replace(m, range_m=(m.range_m or 0.0) + 3.0)),
        words=("too long", "range bias"),
    ),
    Fault(
        "sigmas ten times too small",
        2,
        spoil=each(
            lambda m: replace(
                m,
                range_sigma_m=(m.range_sigma_m or 0.1) / 10,
                paths=tuple(replace(p, sigma=p.sigma / 10) for p in m.paths),
            )
        ),
    ),
    Fault("compass off by 20 deg", 2, Hearing(headings=True), compass_off(20.0)),
    Fault("compass off by 180 deg", 2, Hearing(headings=True), compass_off(180.0)),
)


def of_log(change: Callable[[list[WirelessMeasurement]], list[WirelessMeasurement]]) -> Callable[..., Case]:
    """The log changed as a whole."""
    return lambda case, _: replace(case, log=replace(case.log, measurements=tuple(change(list(case.log.measurements)))))


def stuck(log: list[WirelessMeasurement]) -> list[WirelessMeasurement]:
    """From two thirds on, the receiver repeats its last value."""
    last = log[2 * len(log) // 3]
    return [replace(m, range_m=last.range_m, paths=last.paths) if m.stamp_ns > last.stamp_ns else m for m in log]


def repeated(log: list[WirelessMeasurement]) -> list[WirelessMeasurement]:
    """Each is written five times, milliseconds apart."""
    return [replace(m, stamp_ns=m.stamp_ns + 5_000_000 * k) for m in log for k in range(5)]


def backwards(log: list[WirelessMeasurement]) -> list[WirelessMeasurement]:
    """The last measurement has the first stamp."""
    return [replace(m, stamp_ns=n.stamp_ns) for m, n in zip(log[::-1], log, strict=True)]


def sometimes_longer(m: WirelessMeasurement) -> WirelessMeasurement:
    """Every other range goes by a reflection."""
    return replace(m, range_m=(m.range_m or 0.0) + m.stamp_ns // 1_000_000_000 // 4 % 2 * 5.0)


def fast_clock(case: Case, _: np.random.Generator) -> Case:
    """Robot b's clock runs 3 % too fast."""
    b = case.odometry["b"]
    stamps_ns = b.stamps_ns[0] + ((b.stamps_ns - b.stamps_ns[0]) * 1.03).astype(np.int64)
    return replace(case, odometry={**case.odometry, "b": replace(b, stamps_ns=stamps_ns)})


# No correction knows these.
UNSEEN = (
    Fault("ranges bent by distance", 3, spoil=each(lambda m: replace(m, range_m=(m.range_m or 0.0) ** 2 / 20.0))),
    Fault("azimuths halved", 3, spoil=each_path(lambda a: a / 2)),
    Fault(
        "half of the ranges +5 m",
        3,
        spoil=each(lambda m: replace(m, range_m=(m.range_m or 0.0) + m.stamp_ns // 10**9 % 2 * 5)),
    ),
    Fault("receiver gets stuck", 3, spoil=of_log(stuck)),
    Fault("each measurement five times", 1, spoil=of_log(repeated)),
    Fault("clock 3 % fast", 3, spoil=fast_clock),
    Fault(
        "measurements in another order",
        3,
        spoil=of_log(lambda log: [replace(m, stamp_ns=n.stamp_ns) for m, n in zip(log, log[::-1], strict=True)][::-1]),
    ),
)


# Scoring -----------------------------------------------------------------------------------------------------------


@dataclass
class Score:
    """Of all trials of one fault."""

    certain: int = 0
    wrong: int = 0
    lost: int = 0
    named: int = 0
    pairs: int = 0
    crashed: list[str] = field(default_factory=list)
    seconds: float = 0.0


def make(world: World, fault: Fault, rng: np.random.Generator) -> Case:
    """One trial."""
    odometry = world.odometry or {name: drifted(t, rng) for name, t in world.truth.items()}
    return fault.spoil(Case(world.truth, odometry, listen(world, fault.hearing, rng)), rng)


def count_outcome(case: Case, result: FilterResult, fault: Fault, score: Score) -> None:
    """Adds a trial's outcome."""
    score.named += any(any(word in sentence for word in fault.words) for sentence in result.diagnosis)
    kept = {(p.robot_a, p.robot_b): p for p in result.pairs}
    for alignment in result.alignments:
        score.pairs += 1
        if alignment.ambiguous or alignment.best is None or alignment.covariance is None:
            continue
        score.certain += 1
        a, b = alignment.robot_a, alignment.robot_b
        near = np.linalg.norm(case.truth[a].positions[:, None] - case.truth[b].positions[None], axis=2) <= NEAR_M
        found = np.zeros_like(near)
        pairs = kept[a, b]
        found[pairs.index_a, pairs.index_b] = True
        lost = 1.0 - (near & found).sum() / max(near.sum(), 1)
        score.lost += bool(lost > 0.05)
        off_m, off_rad, chi2 = _off(case, a, b, alignment.best.T_a_b, alignment.covariance)
        off = off_m > WRONG_M or off_rad > WRONG_RAD
        score.wrong += bool(off and (chi2 > 9.0 or lost > 0.05))


def _off(case: Case, a: str, b: str, T_a_b: FloatArray, covariance: FloatArray) -> tuple[float, float, float]:
    """Error at the middle of the meeting: m, rad, and the larger chi-square of the two, each a number in the plane."""
    row = len(case.truth[a]) // 2
    T_odom_a = case.odometry[a].poses[row] @ se3.inverse(case.truth[a].poses[row])
    true = T_odom_a @ case.truth[b].poses[row]
    odom_b = case.odometry[b].poses[row]
    said = T_a_b @ odom_b
    yaw = abs(wrap(float(np.arctan2(said[1, 0], said[0, 0]) - np.arctan2(true[1, 0], true[0, 0]))))
    offset = said[:2, 3] - true[:2, 3]
    by_position = np.zeros((3, 6))
    by_position[:, :3], by_position[:, 3:] = -T_a_b[:3, :3] @ se3.skew(odom_b[:3, 3]), T_a_b[:3, :3]
    spread = (by_position @ covariance @ by_position.T)[:2, :2]
    chi2 = max(float(offset @ np.linalg.solve(spread, offset)), yaw**2 / covariance[2, 2])
    return float(np.linalg.norm(offset)), yaw, chi2


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=30, help="in each world")
    parser.add_argument("--faults", default="", help="only those whose name holds one of these words, comma separated")
    parser.add_argument("--unseen", action="store_true", help="faults that no correction knows, instead")
    parser.add_argument("--worlds", default=",".join(WORLDS))
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    words = [word for word in arguments.faults.split(",") if word]
    print(f"{'fault':28} {'certain':>8} {'wrong':>6} {'goal':>5} {'lost':>5} {'named':>6} {'ms':>6}  of pairs")
    for fault in UNSEEN if arguments.unseen else FAULTS:
        if words and not any(word in fault.name for word in words):
            continue
        score = Score()
        trials = 0
        for world in arguments.worlds.split(","):
            for trial in range(arguments.trials):
                rng = np.random.default_rng([arguments.seed, list(WORLDS).index(world), trial])
                case = make(WORLDS[world](fault.robots, rng), fault, rng)
                began = time.perf_counter()
                try:
                    result = WiClosureFilter().candidates(case.odometry, case.log)
                except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
                    score.crashed.append(f"{world} {trial}: {error!r}")
                    continue
                score.seconds += time.perf_counter() - began
                count_outcome(case, result, fault, score)
                trials += 1
        named = f"{score.named / trials:6.0%}" if fault.words else "     -"
        print(
            f"{fault.name:28} {score.certain:8d} {score.wrong:6d} {fault.goal:5d} {score.lost:5d} {named}"
            f" {1000 * score.seconds / trials:6.0f}  {score.pairs}",
            flush=True,
        )
        for crash in score.crashed:
            print("   crashed:", crash)


if __name__ == "__main__":
    main()
