"""Random teams, and all forms in which their graphs may be written."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wiclosure import se3

SIGMA = np.repeat([0.01, 0.05], 3)
LOOP_SIGMA = 2 * SIGMA
ROTATION_FIRST = np.array([3, 4, 5, 0, 1, 2])


@dataclass(frozen=True)
class WrittenTeam:
    """Steps `(N - 1, 4, 4)` of each robot; loops between poses (robot, index), with `T_query_match`."""

    steps: list[np.ndarray]
    loops: list[tuple[tuple[int, int], tuple[int, int], np.ndarray]]

    def sizes(self):
        return [len(steps) + 1 for steps in self.steps]

    def chained(self, T_world_first):
        """`T_world_body (N, 4, 4)` of each robot, from its odometry."""
        found = []
        for steps, T in zip(self.steps, T_world_first, strict=True):
            poses = [T]
            for step in steps:
                poses.append(poses[-1] @ step)
            found.append(np.stack(poses))
        return found


def random_team(seed, robots=2, *, planar=False, n_loops=6, size=None) -> WrittenTeam:
    """Noisy odometry and true loops, among them those from a robot's last pose to the next one's first."""
    rng = np.random.default_rng(seed)

    def noise(shape, sigma):
        xi = rng.normal(size=(*shape, 6)) * sigma
        return se3.exp(xi * [0, 0, 1, 1, 1, 0] if planar else xi)

    truth, steps = [], []
    for _ in range(robots):
        n = size or int(rng.integers(4, 12))
        xi = np.tile([0, 0, 0, 1.0, 0, 0], (n - 1, 1))
        xi[:, 2] = rng.normal(0, 0.5, n - 1)
        exact = se3.exp(xi)
        start = se3.from_yaw(rng.uniform(-3, 3), np.append(rng.uniform(-5, 5, 2), 0.0))
        truth.append(WrittenTeam([exact], []).chained([start])[0])
        steps.append(exact @ noise((n - 1,), SIGMA))
    ends = [((r, len(steps[r])), (r + 1, 0)) for r in range(robots - 1)]
    for _ in range(n_loops):
        a, b = rng.integers(0, robots, 2)
        i, j = rng.integers(0, len(truth[a])), rng.integers(0, len(truth[b]))
        if a != b or abs(i - j) > 1:
            ends.append(((int(a), int(i)), (int(b), int(j))))
    ends = list(dict.fromkeys(ends))
    loops = [(q, m, se3.between(truth[q[0]][q[1]], truth[m[0]][m[1]]) @ noise((), LOOP_SIGMA)) for q, m in ends]
    return WrittenTeam(steps, loops)


def text(numbers):
    return " ".join(map(repr, np.asarray(numbers, float).tolist()))


def quaternion(T):
    return text([*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_quat()])


def euler(T):
    return text([*T[:3, 3], *Rotation.from_matrix(T[:3, :3]).as_euler("xyz")])


def flat(T):
    return text([*T[:2, 3], se3.yaw(T)])


def full(sigma):
    return text(np.diag(1 / sigma[ROTATION_FIRST] ** 2)[np.triu_indices(6)])


def inside(sigma):
    return text(np.diag(1 / sigma[[3, 4, 2]] ** 2)[np.triu_indices(3)])


def toro(sigma):
    xx, yy, tt = 1 / sigma[[3, 4, 2]] ** 2
    return text([xx, 0, yy, tt, 0, 0])


DIALECTS = {
    "g2o": ("VERTEX_SE3:QUAT", "EDGE_SE3:QUAT", quaternion, full),
    "toro3": ("VERTEX3", "EDGE3", euler, full),
    "g2o-planar": ("VERTEX_SE2", "EDGE_SE2", flat, inside),
    "toro2": ("VERTEX2", "EDGE2", flat, toro),
}


def lines(team, keys, dialect="g2o", starts=None):
    """Vertex, step and loop lines of each robot; loops stand with the robot of their first pose."""
    vertex, edge, pose, information = DIALECTS[dialect]
    guesses = team.chained(starts or [np.eye(4)] * len(team.steps))
    found = [
        [f"{vertex} {keys(r, n)} {pose(T)}" for n, T in enumerate(poses)]
        + [f"{edge} {keys(r, n)} {keys(r, n + 1)} {pose(T)} {information(SIGMA)}" for n, T in enumerate(team.steps[r])]
        for r, poses in enumerate(guesses)
    ]
    for (a, i), (b, j), T in team.loops:
        found[a].append(f"{edge} {keys(a, i)} {keys(b, j)} {pose(T)} {information(LOOP_SIGMA)}")
    return found


def interleaved(team, seed):
    """Plain numbers in a random order that keeps each robot's."""
    rng = np.random.default_rng(seed)
    count = np.array(team.sizes())
    owners = np.concatenate([np.arange(len(count)), rng.permutation(np.repeat(np.arange(len(count)), count - 1))])
    place = {(int(r), n): int(k) for r in np.unique(owners) for n, k in enumerate(np.flatnonzero(owners == r))}
    return lambda r, n: place[r, n]


def symbols(r, n):
    return (ord("a") + r << 56) + n


def labelled(r, n):
    return (ord("g") << 56) + (ord("A") + r << 48) + n


def blocks(team):
    first = np.cumsum([0, *team.sizes()]).tolist()
    return lambda r, n: first[r] + n


def write(folder: Path, of_robots, *, apart=False) -> list[Path]:
    groups = of_robots if apart else [[line for of_robot in of_robots for line in of_robot]]
    paths = []
    for n, group in enumerate(groups):
        paths.append(folder / f"robot{n}.g2o")
        paths[-1].write_text("\n".join(group) + "\n")
    return paths


def value(T, *, planar=False):
    if planar:
        return {"type": "Pose2", "x": T[0, 3], "y": T[1, 3], "theta": float(se3.yaw(T))}
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat().tolist()
    return {"type": "Pose3", "translation": T[:3, 3].tolist(), "rotation": [w, x, y, z]}


def robot_log(team, *, planar=False, false=()):
    """A JSON Robot Log; loops stand in the last entry of the robot of their first pose."""
    axes = [3, 4, 2] if planar else list(range(6))
    kind = "BetweenFactorPose2" if planar else "BetweenFactorPose3"

    def factor(first, second, T, sigma):
        covariance = np.diag(np.square(sigma[axes])).ravel().tolist()
        ends = {"key1": symbols(*first), "key2": symbols(*second)}
        return {"type": kind, **ends, "measurement": value(T, planar=planar), "covariance": covariance}

    names = [chr(ord("a") + r) for r in range(len(team.steps))]
    entries = {
        name: [
            {"stamp": n, "measurements": [factor((r, n), (r, n + 1), T, SIGMA)]} for n, T in enumerate(team.steps[r])
        ]
        + [{"stamp": 10**6, "measurements": []}]
        for r, name in enumerate(names)
    }
    may_be_false = {name: [] for name in names}
    outliers = {name: [] for name in names}
    for row, (q, m, T) in enumerate(team.loops):
        last = entries[names[q[0]]][-1]["measurements"]
        place = [len(entries[names[q[0]]]) - 1, len(last)]
        may_be_false[names[q[0]]].append(place)
        outliers[names[q[0]]] += [place] if row in false else []
        last.append(factor(q, m, T, LOOP_SIGMA))
    return {
        "name": "random",
        "robots": [ord(name) for name in names],
        "measurements": entries,
        "potential_outlier_factors": may_be_false,
        "outlier_factors": outliers,
    }


def written(form: str, seed: int, folder: Path, **options) -> tuple[WrittenTeam, list[Path]]:
    """A random team in one of the forms."""
    planar = "planar" in form or form == "toro2"
    team = random_team(seed, planar=planar, **options)
    if "robot log" in form:
        path = folder / "team.jrl"
        path.write_text(json.dumps(robot_log(team, planar=planar)))
        return team, [path]
    plain = interleaved(team, seed) if "interleaved" in form else blocks(team)
    keys = {"labelled": labelled}.get(
        form, symbols if "symbols" in form or form in ("toro3", "toro2", "planar") else plain
    )
    dialect = form if form.startswith("toro") else "g2o-planar" if planar else "g2o"
    return team, write(folder, lines(team, keys, dialect), apart="one file" in form)


@pytest.fixture(scope="session")
def forms():
    """What is defined here, as a fixture because test folders are no packages."""
    import sys

    return sys.modules[__name__]
