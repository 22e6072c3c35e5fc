"""Pose graphs for the benchmark of the back end: read from files or made, cut into teams, and spoiled."""

from __future__ import annotations

import lzma
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import gtsam
import numpy as np
from kitti import DATA
from scipy.spatial import cKDTree

from wiclosure import se3
from wiclosure.types import Closure, FloatArray, IntArray, KeyframeId, Trajectory

GRAPHS = DATA / "pose_graphs"


@dataclass(frozen=True, eq=False)
class Graph:
    """Relative poses between nodes `0 .. size - 1`; edges between consecutive nodes of one robot are its odometry.

    Args:
        first, second, T, covariance: the edges, `(M,)`, `(M,)`, `(M, 4, 4)` and `(M, 6, 6)`.
        robot: `(N,)` robot of each node; nodes of one robot follow each other.
        truth: `(N, 4, 4)` true poses; None where nobody knows them.
    """

    first: IntArray
    second: IntArray
    T: FloatArray
    covariance: FloatArray
    robot: IntArray
    truth: FloatArray | None = None

    def cut(self, robots: int) -> Graph:
        """The same nodes as the contiguous parts of so many robots."""
        size = len(self.robot)
        return replace(self, robot=np.minimum(np.arange(size) * robots // size, robots - 1))

    def is_odometry(self) -> np.ndarray:
        """Which edges `(M,)` join consecutive nodes of a robot, the first of each such pair."""
        step = (self.second - self.first == 1) & (self.robot[self.first] == self.robot[self.second])
        _, leading = np.unique(self.first[step], return_index=True)
        chosen = np.zeros(len(step), bool)
        chosen[np.flatnonzero(step)[leading]] = True
        return chosen


@dataclass(frozen=True, eq=False)
class CutTeam:
    """What the back end is given, and what it should find."""

    odometry: dict[str, Trajectory]
    closures: list[Closure]
    true: np.ndarray
    graph: Graph


def team(graph: Graph, seed: int, share_false: float, false: Callable[..., list[Closure]] | None = None) -> CutTeam:
    """Every robot in a frame of its own; of all closures, `share_false` are false ones, shuffled in."""
    rng = np.random.default_rng(seed)
    odometry, names, start = {}, [], np.zeros(len(graph.robot), int)
    edge = graph.is_odometry()
    of_step = dict(zip(graph.first[edge].tolist(), np.flatnonzero(edge).tolist(), strict=True))
    for robot in np.unique(graph.robot):
        nodes = np.flatnonzero(graph.robot == robot)
        steps = [of_step[n] for n in nodes[:-1]]
        poses = [random_pose(rng, 50.0)]
        for T in graph.T[steps]:
            poses.append(poses[-1] @ T)
        name = f"r{robot}"
        names.append(name)
        start[nodes] = nodes[0]
        stamps_ns = np.arange(len(nodes), dtype=np.int64) * 10**9
        odometry[name] = Trajectory(name, stamps_ns, np.stack(poses), step_covariances=graph.covariance[steps])
    closures = [
        closure(names, graph, int(i), int(j), T, C, start)
        for i, j, T, C in zip(
            graph.first[~edge], graph.second[~edge], graph.T[~edge], graph.covariance[~edge], strict=True
        )
    ]
    true = len(closures)
    n_false = round(true * share_false / (1 - share_false))
    if n_false:
        closures += (false or random_loops)(graph, names, start, rng, n_false)
    order = rng.permutation(len(closures))
    return CutTeam(odometry, [closures[n] for n in order], order < true, graph)


def closure(
    names: Sequence[str], graph: Graph, i: int, j: int, T: FloatArray, covariance: FloatArray, start: IntArray
) -> Closure:
    """Between two nodes, by the names of their robots."""
    query, match = (KeyframeId(names[graph.robot[n]], int(n - start[n])) for n in (i, j))
    return Closure.from_measurement(query, match, T, covariance)


def random_loops(
    graph: Graph, names: Sequence[str], start: IntArray, rng: np.random.Generator, count: int, reach: float = 1.0
) -> list[Closure]:
    """Between any two robots; of any rotation, and as far as true closures reach or further; flat in a flat graph."""
    return _loops(graph, names, start, rng, count, reach, own=False)


def own_loops(
    graph: Graph, names: Sequence[str], start: IntArray, rng: np.random.Generator, count: int
) -> list[Closure]:
    """The same within robots."""
    return _loops(graph, names, start, rng, count, 1.0, own=True)


def _loops(
    graph: Graph,
    names: Sequence[str],
    start: IntArray,
    rng: np.random.Generator,
    count: int,
    reach: float,
    *,
    own: bool,
) -> list[Closure]:
    loops = np.flatnonzero(~graph.is_odometry())
    length = float(np.linalg.norm(graph.T[loops, :3, 3], axis=1).mean()) * reach
    flat = not np.abs(graph.T[:, 2, 3]).any()
    made: list[Closure] = []
    while len(made) < count:
        i, j = rng.integers(0, len(graph.robot), 2)
        if (graph.robot[i] == graph.robot[j]) != own or (own and abs(i - j) < 2):
            continue
        C, T = graph.covariance[rng.choice(loops)], random_pose(rng, length)
        if flat:
            T = se3.from_yaw(rng.uniform(-np.pi, np.pi), T[:3, 3] * [1.0, 1.0, 0.0])
        made.append(closure(names, graph, int(i), int(j), T, C, start))
    return made


def far_loops(graph: Graph, names: Sequence[str], start: IntArray, rng: np.random.Generator, n: int) -> list[Closure]:
    """The same, ten times as long."""
    return random_loops(graph, names, start, rng, n, reach=10.0)


def look_alike_loops(
    graph: Graph, names: Sequence[str], start: IntArray, rng: np.random.Generator, count: int
) -> list[Closure]:
    """Clusters of five that agree: neighbouring nodes of two places that look alike."""
    loops = np.flatnonzero(~graph.is_odometry())
    made: list[Closure] = []
    ends = np.random.default_rng(0).permutation(len(graph.robot))
    poses = chained(graph)
    while len(made) < count:
        i, j = ends[rng.integers(0, len(ends), 2)]
        if graph.robot[i] == graph.robot[j]:
            continue
        T = random_pose(rng, 2.0)
        shift = poses[i] @ T @ se3.inverse(poses[j])
        for n in range(min(5, count - len(made))):
            a, b = i + n, j + n
            if b >= len(graph.robot) or a >= len(graph.robot) or graph.robot[a] != graph.robot[i]:
                continue
            if graph.robot[b] != graph.robot[j]:
                continue
            C = graph.covariance[rng.choice(loops)]
            noise = se3.exp(rng.multivariate_normal(np.zeros(6), C))
            T_ab = se3.between(poses[a], shift @ poses[b]) @ noise
            made.append(closure(names, graph, int(a), int(b), T_ab, C, start))
    return made[:count]


def chained(graph: Graph) -> FloatArray:
    """Poses of all nodes by odometry, each robot from the identity."""
    poses = np.tile(np.eye(4), (len(graph.robot), 1, 1))
    for row in np.flatnonzero(graph.is_odometry()):
        poses[graph.second[row]] = poses[graph.first[row]] @ graph.T[row]
    return poses


def random_pose(rng: np.random.Generator, spread_m: float) -> FloatArray:
    """Any rotation, a translation of so many metres on each axis."""
    q = rng.normal(size=4)
    return np.asarray(gtsam.Pose3(gtsam.Rot3.Quaternion(*(q / np.linalg.norm(q))), rng.normal(0, spread_m, 3)).matrix())


# ----------------------------------------------------------------------------------------------------------- from files
def read(name: str) -> Graph:
    """A standard graph, or a team of `distributed_mapper`, whose robots the keys name."""
    path = GRAPHS / name
    if path.is_dir():
        return _team_of_files(sorted(path.glob("[0-9]*.g2o")))
    if path.suffix == ".xz":
        with tempfile.TemporaryDirectory() as folder:
            unpacked = Path(folder) / path.stem
            unpacked.write_bytes(lzma.decompress(path.read_bytes()))
            return _of_edges(_edges(unpacked), lambda key: 0)
    return _of_edges(_edges(path), lambda key: 0)


def _edges(path: Path) -> dict[tuple[int, int], tuple[FloatArray, FloatArray]]:
    graph, _ = gtsam.readG2o(str(path), True)
    found = {}
    for n in range(graph.size()):
        factor = graph.at(n)
        assert isinstance(factor, gtsam.BetweenFactorPose3)
        noise = factor.noiseModel()
        assert isinstance(noise, gtsam.noiseModel.Gaussian)
        first, second = factor.keys()
        found[first, second] = (factor.measured().matrix(), noise.covariance())
    return found


def _team_of_files(paths: Sequence[Path]) -> Graph:
    edges: dict[tuple[int, int], tuple[FloatArray, FloatArray]] = {}
    for path in paths:
        edges |= _edges(path)
    return _of_edges(edges, lambda key: key >> 56)


def _of_edges(edges: dict[tuple[int, int], tuple[FloatArray, FloatArray]], robot_of: Callable[[int], int]) -> Graph:
    keys = sorted({key for pair in edges for key in pair})
    index = {key: n for n, key in enumerate(keys)}
    first, second = (np.array([index[pair[end]] for pair in edges]) for end in (0, 1))
    T, covariance = (np.stack([edge[part] for edge in edges.values()]) for part in (0, 1))
    turned = first > second
    covariance[turned] = se3.inverse_covariance(T[turned], covariance[turned])
    T[turned] = se3.inverse(T[turned])
    first, second = np.minimum(first, second), np.maximum(first, second)
    _, robot = np.unique([robot_of(key) for key in keys], return_inverse=True)
    return _with_odometry(Graph(first, second, T, covariance, robot))


def _with_odometry(graph: Graph) -> Graph:
    """Nodes put in an order in which consecutive ones of a robot are joined by an edge, where there is such an order.

    The robots of `distributed_mapper` sweep a grid: their keys have gaps, and not all consecutive ones are joined.
    """
    missing = []
    joined = {(int(a), int(b)) for a, b in zip(graph.first, graph.second, strict=True)}
    for robot in np.unique(graph.robot):
        nodes = np.flatnonzero(graph.robot == robot).tolist()
        missing += [(a, b) for a, b in pairwise(nodes) if (a, b) not in joined]
    if not missing:
        return graph
    order = np.concatenate([_path(graph, robot) for robot in np.unique(graph.robot)])
    new = np.empty(len(order), int)
    new[order] = np.arange(len(order))
    first, second, T, C = new[graph.first], new[graph.second], graph.T.copy(), graph.covariance.copy()
    turned = first > second
    C[turned], T[turned] = se3.inverse_covariance(T[turned], C[turned]), se3.inverse(T[turned])
    first, second = np.minimum(first, second), np.maximum(first, second)
    return replace(graph, first=first, second=second, T=T, covariance=C, robot=graph.robot[order])


def _path(graph: Graph, robot: int) -> IntArray:
    """A path through all nodes of one robot along its own edges, by depth-first search with look-ahead."""
    own = (graph.robot[graph.first] == robot) & (graph.robot[graph.second] == robot)
    near: dict[int, set[int]] = {int(n): set() for n in np.flatnonzero(graph.robot == robot)}
    for a, b in zip(graph.first[own].tolist(), graph.second[own].tolist(), strict=True):
        near[a].add(b)
        near[b].add(a)
    for start, neighbours in near.items():
        path, seen = [start], {start}
        stack = [sorted(neighbours, key=lambda n: len(near[n]))]
        while stack and len(path) < len(near):
            while stack[-1] and stack[-1][0] in seen:
                stack[-1].pop(0)
            if not stack[-1]:
                stack.pop()
                seen.discard(path.pop())
                continue
            node = stack[-1].pop(0)
            path.append(node)
            seen.add(node)
            stack.append(sorted(near[node] - seen, key=lambda n: len(near[n] - seen)))
        if len(path) == len(near):
            return np.array(path)
    raise ValueError(f"robot {robot}: no path along its own edges")


# ---------------------------------------------------------------------------------------------------------------- made
def noisy(
    truth: FloatArray,
    loops: IntArray,
    sigma: FloatArray,
    rng: np.random.Generator,
    odometry_sigma: FloatArray | None = None,
) -> Graph:
    """Steps between consecutive true poses and loops `(L, 2)`, each with its stated noise."""
    n = len(truth)
    steps = np.stack([np.arange(n - 1), np.arange(1, n)], axis=1)
    ends = np.concatenate([steps, loops])
    s = np.tile(sigma, (len(ends), 1))
    s[: n - 1] = sigma if odometry_sigma is None else odometry_sigma
    T = se3.between(truth[ends[:, 0]], truth[ends[:, 1]]) @ se3.exp(rng.normal(size=(len(ends), 6)) * s)
    covariance = s[:, :, None] ** 2 * np.eye(6)
    return Graph(ends[:, 0], ends[:, 1], T, covariance, np.zeros(n, int), truth)


def revisits(positions: FloatArray, radius: float, gap: int, count: int, rng: np.random.Generator) -> IntArray:
    """`(L, 2)` at most `count` pairs of nodes nearer than `radius`, at least `gap` apart along the path."""
    pairs = cKDTree(positions).query_pairs(radius, output_type="ndarray")
    pairs = np.sort(pairs[np.abs(pairs[:, 0] - pairs[:, 1]) >= gap], axis=1)
    return rng.permutation(pairs)[:count]


def facing(positions: FloatArray) -> FloatArray:
    """Poses that look along the path."""
    ahead = np.gradient(positions, axis=0)
    return se3.from_yaw(np.arctan2(ahead[:, 1], ahead[:, 0]), positions)


def lawn_mower(seed: int, sigma: tuple[float, float] = (0.01, 0.05), rows: int = 20, columns: int = 40) -> Graph:
    """A plane swept in lanes, then across them."""
    rng = np.random.default_rng(seed)
    lanes = [(x if y % 2 == 0 else columns - 1 - x, y) for y in range(rows) for x in range(columns)]
    across = [(x, y if (x // 2) % 2 == 0 else rows - 1 - y) for x in range(0, columns, 2) for y in range(rows)]
    positions = np.array([(x, y, 0.0) for x, y in lanes + across[::-1]])
    s = np.repeat(sigma, 3)
    return noisy(facing(positions), revisits(positions, 1.1, 5, 1200, rng), s, rng)


def streets(seed: int, sigma: tuple[float, float] = (0.01, 0.1), poses: int = 1500) -> Graph:
    """Blocks of 20 m, a metre a step, turns at random; loops within 4 m."""
    rng = np.random.default_rng(seed)
    at, along, visited = np.zeros(2), np.array([1.0, 0.0]), []
    for n in range(poses):
        visited.append([*at, 0.0])
        if n % 20 == 0:
            left = np.array([-along[1], along[0]])
            choices = [v for v in (along, left, -left) if np.abs(at + 20 * v).max() <= 60]
            along = choices[rng.integers(len(choices))]
        at = at + along
    positions = np.array(visited)
    loops = revisits(positions, 4.0, 40, 600, rng)
    return noisy(facing(positions), loops, np.repeat(sigma, 3), rng, np.repeat([0.003, 0.03], 3))


def grid(seed: int, sigma: tuple[float, float] = (0.05, 0.1), side: int = 8) -> Graph:
    """A cube of nodes walked lane by lane, neighbours joined; rotations at random."""
    rng = np.random.default_rng(seed)
    cells = []
    for z in range(side):
        for y in range(side):
            lane = [(x, y if z % 2 == 0 else side - 1 - y, z) for x in range(side)]
            cells += lane if (y + z) % 2 == 0 else lane[::-1]
    positions = np.array(cells, float)
    truth = positioned(positions, rng)
    loops = revisits(positions, 1.1, 2, 10**6, rng)
    return noisy(truth, rng.permutation(loops)[: len(loops) * 6 // 10], np.repeat(sigma, 3), rng)


def sphere(seed: int, sigma: tuple[float, float] = (0.05, 0.1), rings: int = 20, around: int = 40) -> Graph:
    """Rings from pole to pole, each pose joined to the one below."""
    rng = np.random.default_rng(seed)
    n = np.arange(rings * around)
    up, turn = np.pi * (n + 1) / (rings * around + 1), 2 * np.pi * n / around
    positions = 10.0 * np.stack([np.sin(up) * np.cos(turn), np.sin(up) * np.sin(turn), -np.cos(up)], axis=1)
    loops = np.stack([n[:-around], n[around:]], axis=1)
    return noisy(facing(positions), loops, np.repeat(sigma, 3), rng)


def garage(seed: int, sigma: tuple[float, float] = (0.005, 0.05), levels: int = 5, around: int = 120) -> Graph:
    """Rounds up a ramp and down again, half a metre a step; loops to the round below and on the way back."""
    rng = np.random.default_rng(seed)
    n = np.arange(levels * around)
    up = np.stack([20 * np.cos(2 * np.pi * n / around), 12 * np.sin(2 * np.pi * n / around), 3.0 * n / around], axis=1)
    positions = np.concatenate([up, np.array([0.5, 0.5, 0.0]) + up[::-1]])
    loops = revisits(positions, 3.2, 60, 1500, rng)
    return noisy(facing(positions), loops, np.repeat(sigma, 3), rng, np.repeat([0.004, 0.02], 3))


def meadow(seed: int, sigma: tuple[float, float] = (0.03, 0.2), poses: int = 1000) -> Graph:
    """A path that wanders at will; few loops, noisy ones."""
    rng = np.random.default_rng(seed)
    turn = np.cumsum(rng.normal(0, 0.15, poses))
    positions = np.zeros((poses, 3))
    for n in range(1, poses):
        home = np.arctan2(-positions[n - 1, 1], -positions[n - 1, 0])
        far = np.linalg.norm(positions[n - 1]) > 40
        heading = home if far else turn[n]
        positions[n] = positions[n - 1] + [np.cos(heading), np.sin(heading), 0.0]
    loops = revisits(positions, 3.0, 30, 250, rng)
    return noisy(facing(positions), loops, np.repeat(sigma, 3), rng, np.repeat([0.005, 0.05], 3))


def city(seed: int, poses: int = 10_000, loops: int = 10_009) -> Graph:
    """A plane walked street by street, as in `city10000`: nothing leaves the plane, and all is stated for space."""
    rng = np.random.default_rng(seed)
    truth, at, heading = np.tile(np.eye(4), (poses, 1, 1)), np.zeros(2), 0
    for n in range(poses):
        truth[n] = se3.from_yaw(heading * np.pi / 2, np.array([*at, 0.0]))
        turns = [0] if n % 5 else rng.permutation([0, 1, 3, 2])
        ahead = (at + np.rint([np.cos(h * np.pi / 2), np.sin(h * np.pi / 2)]) for h in (heading + t for t in turns))
        t, at = next((t, a) for t, a in zip(turns, ahead, strict=True) if np.abs(a).max() <= 50)
        heading = (heading + t) % 4
    graph = noisy(truth, revisits(truth[:, :3, 3], 2.1, 20, loops, rng), np.repeat([0.01, 0.05], 3), rng)
    yaw, positions = se3.log(graph.T)[:, 2], graph.T[:, :3, 3] * [1.0, 1.0, 0.0]
    return replace(graph, T=se3.from_yaw(yaw, positions))


def cubicle(seed: int, poses: int = 4_000, loops: int = 9_002, side: int = 12) -> Graph:
    """A lattice in a cube walked at random, rotations of any kind: many loops for each pose."""
    rng = np.random.default_rng(seed)
    positions, ways = np.zeros((poses, 3)), np.concatenate([np.eye(3), -np.eye(3)])
    for n in range(1, poses):
        allowed = [way for way in ways if np.abs(positions[n - 1] + way - side / 2).max() <= side / 2]
        positions[n] = positions[n - 1] + allowed[rng.integers(len(allowed))]
    truth = positioned(positions, rng)
    return noisy(truth, revisits(positions, 1.5, 2, loops, rng), np.repeat([0.05, 0.1], 3), rng)


def torus(seed: int, rings: int = 50, around: int = 100, loops: int = 4_051) -> Graph:
    """Rings about a torus, most poses joined to the ring before."""
    rng = np.random.default_rng(seed)
    n = np.arange(rings * around)
    along, about = 2 * np.pi * n / (rings * around), 2 * np.pi * n / around
    positions = 10.0 * np.stack([np.cos(along), np.sin(along), np.zeros(len(n))], axis=1)
    positions *= (1.0 + 0.4 * np.cos(about))[:, None]
    positions[:, 2] = 4.0 * np.sin(about)
    ends = rng.permutation(np.stack([n[:-around], n[around:]], axis=1))[:loops]
    return noisy(facing(positions), ends, np.repeat([0.02, 0.05], 3), rng)


def positioned(positions: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Poses at these places, of any rotation."""
    q = rng.normal(size=(len(positions), 4))
    rotations = np.stack([gtsam.Rot3.Quaternion(*(v / np.linalg.norm(v))).matrix() for v in q])
    return se3.from_rotation_translation(rotations, positions)


def town(seed: int, robots: int, poses: int, loops: int) -> Graph:
    """Many robots in one town of blocks of 20 m, each from a crossing of its own."""
    rng, paths = np.random.default_rng(seed), []
    for _ in range(robots):
        at, along = 20.0 * rng.integers(-6, 7, 2), np.array([1.0, 0.0])
        for n in range(poses):
            paths.append([*at, 0.0])
            if n % 20 == 0:
                left = np.array([-along[1], along[0]])
                choices = [v for v in (along, left, -left) if np.abs(at + 20 * v).max() <= 160]
                along = choices[rng.integers(len(choices))]
            at = at + along
    positions, robot = np.array(paths), np.repeat(np.arange(robots), poses)
    ends = revisits(positions, 3.0, 40, loops, rng)
    graph = noisy(facing(positions), ends, np.repeat([0.01, 0.1], 3), rng, np.repeat([0.003, 0.03], 3))
    kept = np.ones(len(graph.first), bool)
    kept[: len(robot) - 1] = robot[1:] == robot[:-1]
    return Graph(graph.first[kept], graph.second[kept], graph.T[kept], graph.covariance[kept], robot, graph.truth)


MADE: dict[str, Callable[[int], Graph]] = {"lawn": lawn_mower, "streets": streets, "grid": grid, "sphere": sphere}
HELD_OUT: dict[str, Callable[[int], Graph]] = {"garage": garage, "meadow": meadow}
"""Kinds of graphs that the back end was not built with."""

LARGE: dict[str, tuple[Callable[[int], Graph], int]] = {
    "city": (city, 10),
    "cubicle": (cubicle, 3),
    "torus": (torus, 3),
}
"""Graphs of thousands of poses and loops, and in how many robots they are cut."""

FILES = (
    "standard/tinyGrid3D.g2o",
    "standard/smallGrid3D.g2o",
    "standard/sphere2500.g2o.xz",
    "distributed_mapper/example_4robots",
    "distributed_mapper/4robots",
    "distributed_mapper/9robots",
)
