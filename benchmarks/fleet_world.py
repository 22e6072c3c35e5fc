"""A fleet in the plan of a city: each robot drives about its own blocks, and hears those nearby."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.spatial import cKDTree
from systematic_worlds import drifted

from wiclosure import se3
from wiclosure.types import AoaPath, FloatArray, IntArray, Trajectory, WirelessLog, WirelessMeasurement

BLOCK_M, APART_M, STEP_M, STEP_NS = 100.0, 140.0, 2.0, 400_000_000
REACH_M, RANGE_SIGMA_M, AOA_SIGMA_RAD = 150.0, 0.5, np.deg2rad(10.0)
FALSE_PATHS, ABSENT = 2, 0.15
ROBOTS_HEARD, PER_LINK = 4, 20  # links for each robot, and measurements for each link


@dataclass(frozen=True)
class Fleet:
    """Robots with ground truth in one frame and odometry each in its own; equal stamps in both."""

    truth: dict[str, Trajectory]
    odometry: dict[str, Trajectory]
    wireless: WirelessLog


def fleet(robots: int, *, keyframes: int = 500, seed: int = 0) -> Fleet:
    """The plan grows with the robots, so that each has as many neighbours in a small fleet as in a large one."""
    rng = np.random.default_rng(seed)
    names = [f"r{number:04d}" for number in range(robots)]
    columns = int(np.ceil(np.sqrt(robots)))
    homes = [APART_M * np.array(divmod(number, columns)) for number in range(robots)]
    truth = {name: _drive(name, home, keyframes, rng) for name, home in zip(names, homes, strict=True)}
    odometry = {name: drifted(t, rng, np.eye(4)) for name, t in truth.items()}
    return Fleet(truth, odometry, _heard(truth, rng))


def _drive(name: str, home: FloatArray, keyframes: int, rng: np.random.Generator) -> Trajectory:
    """Along the streets, turning at crossings, back towards home where that is more than two blocks away."""
    corners = [np.round(home / BLOCK_M) * BLOCK_M]
    heading = int(rng.integers(4))
    for _ in range(int(keyframes * STEP_M / BLOCK_M) + 2):
        turns = [(heading + turn) % 4 for turn in (0, 1, 3)]
        options = [corners[-1] + BLOCK_M * _DIRECTIONS[turn] for turn in turns]
        away = np.array([np.linalg.norm(option - home) for option in options])
        weight = np.where(away <= 2 * BLOCK_M, 1.0, 1e-9) / (1 + away)
        chosen = int(rng.choice(3, p=weight / weight.sum()))
        heading = turns[chosen]
        corners.append(options[chosen])
    places = _rounded(np.array(corners), keyframes, float(rng.uniform(0, BLOCK_M / 2)), rng)
    ahead = np.gradient(places, axis=0)
    yaw = np.arctan2(ahead[:, 1], ahead[:, 0])
    poses = se3.from_yaw(yaw, np.column_stack([places, np.zeros(keyframes)]))
    return Trajectory(name, np.arange(keyframes, dtype=np.int64) * STEP_NS, poses)


_DIRECTIONS = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])


def _rounded(corners: FloatArray, keyframes: int, start_m: float, rng: np.random.Generator) -> FloatArray:
    """Points every step along the corners, on its own lane."""
    along = np.concatenate([np.linspace(a, b, int(BLOCK_M), endpoint=False) for a, b in pairwise(corners)])
    window = np.ones(9) / 9
    smooth = np.stack([np.convolve(along[:, axis], window, "valid") for axis in (0, 1)], axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(smooth, axis=0), axis=1))])
    metres = start_m + STEP_M * np.arange(keyframes)
    lane = rng.uniform(-3.0, 3.0, 2)
    return np.stack([np.interp(metres, travelled, smooth[:, axis]) for axis in (0, 1)], axis=1) + lane


def _heard(truth: dict[str, Trajectory], rng: np.random.Generator) -> WirelessLog:
    """So many measurements on each of the shortest links, evenly over the time in which the robots are within reach."""
    names = list(truth)
    positions = np.stack([t.positions[:, :2] for t in truth.values()])
    near = cKDTree(positions.mean(axis=1)).query_pairs(4 * APART_M, output_type="ndarray")
    near = near[np.lexsort((near[:, 1], near[:, 0]))]
    links: list[tuple[float, int, int, IntArray]] = []
    for a, b in near.tolist():
        apart = np.linalg.norm(positions[a] - positions[b], axis=1)
        within = np.flatnonzero(apart <= REACH_M)
        if len(within) >= PER_LINK:
            chosen = within[np.linspace(0, len(within) - 1, PER_LINK).astype(np.int64)]
            links.append((float(np.median(apart[chosen])), a, b, chosen))
    links = sorted(sorted(links)[: ROBOTS_HEARD * len(names)], key=lambda link: link[1:3])
    heard = [m for _, a, b, rows in links for m in _link(truth[names[a]], truth[names[b]], rows, rng)]
    return WirelessLog(tuple(sorted(heard, key=lambda m: m.stamp_ns)))


def _link(a: Trajectory, b: Trajectory, rows: IntArray, rng: np.random.Generator) -> list[WirelessMeasurement]:
    seen = se3.between(a.poses[rows], b.poses[rows])[:, :3, 3]
    found = []
    for stamp_ns, place in zip(a.stamps_ns[rows].tolist(), seen, strict=True):
        azimuths = rng.uniform(-np.pi, np.pi, FALSE_PATHS).tolist()
        if rng.uniform() >= ABSENT:
            azimuths.append(float(se3.wrap_angle(np.arctan2(place[1], place[0]) + rng.normal(0, AOA_SIGMA_RAD))))
        metres = abs(float(np.linalg.norm(place) + rng.normal(0, RANGE_SIGMA_M)))
        paths = tuple(AoaPath(azimuth, AOA_SIGMA_RAD, float(rng.uniform(0.2, 1.0))) for azimuth in azimuths)
        found.append(WirelessMeasurement(stamp_ns, a.robot, b.robot, metres, RANGE_SIGMA_M, paths))
    return found
