"""Rows of the back end's benchmark over graphs of many kinds, whole and cut into teams, against other solvers."""

from __future__ import annotations

import argparse
import resource
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import gtsam
import networkx as nx
import numpy as np
from graphs import (
    FILES,
    HELD_OUT,
    LARGE,
    MADE,
    CutTeam,
    Graph,
    far_loops,
    grid,
    look_alike_loops,
    meadow,
    own_loops,
    random_loops,
    random_pose,
    read,
    team,
    town,
)

from wiclosure import se3
from wiclosure.backends.config import ClosureNoise, PcmSettings, PoseGraphSettings
from wiclosure.backends.consistency.pcm import pairwise_consistent
from wiclosure.backends.estimate.graph_result import GraphResult
from wiclosure.backends.estimate.pose_graph import optimise
from wiclosure.types import BoolArray, Closure, FloatArray, KeyframeId, Stage, Trajectory

STATED = ClosureNoise(translation_m=1e-6, rotation_rad=1e-6)  # closures here state their covariance in full
MAX_SCALE = 10.0  # as `wiclosure optimize`
FIRST_SEED = 20_001  # of the graphs that are measured; smaller ones were used while building
SIGMA = np.repeat([0.01, 0.1], 3)


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of one team."""

    result: GraphResult
    kept: BoolArray
    scale: float
    seconds: float


def solved(odometry: dict[str, Trajectory], closures: list[Closure], pcm: PcmSettings | None = None) -> Outcome:
    """Consistency, then the estimate, as `wiclosure optimize` does; seconds of the processor."""
    began = time.process_time()
    checked = pairwise_consistent(closures, odometry, pcm or PcmSettings(noise=STATED, max_scale=MAX_SCALE))
    result = optimise(
        checked.restated(odometry), checked.closures, PoseGraphSettings(noise=STATED).scaled(checked.scale)
    )
    kept = np.array([c.survived(Stage.ESTIMATE) for c in result.closures], bool)
    return Outcome(result, kept, checked.scale, time.process_time() - began)


# --------------------------------------------------------------------------------------------------------- whole graphs
def whole(arguments: argparse.Namespace) -> None:
    """Every graph as one robot or as the team it is, none false, against GTSAM's solvers."""
    for name, graph in _graphs(arguments):
        of = team(graph, 0, 0.0)
        ours = solved(of.odometry, of.closures)
        factors, odometry = _factors(graph)
        peers = {"LM": _timed(partial(_lm, factors, odometry)), "chordal + LM": _timed(partial(_chordal, factors))}
        if len(graph.first) < 2000:
            peers["GncLM"] = _timed(partial(_gnc, graph, factors, odometry))
        costs = {peer: factors.error(values) for peer, (values, _) in peers.items()}
        best = min(costs["LM"], costs["chordal + LM"])
        cost = ours.result.graph.error(ours.result.values)
        others = ", ".join(f"{peer} {costs[peer]:.1f} in {seconds:.1f} s" for peer, (_, seconds) in peers.items())
        print(
            f"whole {name}: {ours.kept.mean():.1%} of {len(ours.kept)} kept (goal 99.5 %), cost {cost:.1f},"
            f" {cost / max(best, 1e-12):.4f} x the best of LM and chordal (goal 1.001), {ours.seconds:.1f} s; {others}",
            flush=True,
        )


def _factors(graph: Graph) -> tuple[gtsam.NonlinearFactorGraph, gtsam.Values]:
    """All edges with the first pose of the first robot held, and a start along a spanning path of them."""
    factors, start = gtsam.NonlinearFactorGraph(), gtsam.Values()
    for first, second, T, C in zip(graph.first.tolist(), graph.second.tolist(), graph.T, graph.covariance, strict=True):
        noise = gtsam.noiseModel.Gaussian.Covariance(C)
        factors.add(gtsam.BetweenFactorPose3(first, second, gtsam.Pose3(T), noise))
    factors.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-4)))
    for node, pose in enumerate(_placed(graph)):
        start.insert(node, gtsam.Pose3(pose))
    return factors, start


def _placed(graph: Graph) -> FloatArray:
    """Poses by odometry; each robot placed by its first edge to one that is placed."""
    poses = np.tile(np.eye(4), (len(graph.robot), 1, 1))
    steps, done = graph.is_odometry(), np.zeros(len(graph.robot), bool)
    for step in np.flatnonzero(steps):
        poses[graph.second[step]] = poses[graph.first[step]] @ graph.T[step]
    done[graph.robot == graph.robot[0]] = True
    while not done.all():
        row = int(np.flatnonzero(done[graph.first] != done[graph.second])[0])
        i, j, T = int(graph.first[row]), int(graph.second[row]), graph.T[row]
        known, new, T = (i, j, T) if done[i] else (j, i, se3.inverse(T))
        members = graph.robot == graph.robot[new]
        poses[members] = poses[known] @ T @ se3.inverse(poses[new]) @ poses[members]
        done |= members
    return poses


def _lm(factors: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> gtsam.Values:
    return gtsam.LevenbergMarquardtOptimizer(factors, start).optimize()


def _chordal(factors: gtsam.NonlinearFactorGraph) -> gtsam.Values:
    return _lm(factors, gtsam.InitializePose3.initialize(factors))


def _gnc(graph: Graph, factors: gtsam.NonlinearFactorGraph, start: gtsam.Values) -> gtsam.Values:
    parameters = gtsam.GncLMParams()
    known = [*np.flatnonzero(graph.is_odometry()).tolist(), factors.size() - 1]
    parameters.setKnownInliers(known)
    return gtsam.GncLMOptimizer(factors, start, parameters).optimize()


def _timed(solve: Callable[[], gtsam.Values]) -> tuple[gtsam.Values, float]:
    began = time.process_time()
    return solve(), time.process_time() - began


# ---------------------------------------------------------------------------------------------------------------- teams
def cut(arguments: argparse.Namespace) -> None:
    """Every graph cut into robots with unknown starts, with false loops of three kinds."""
    kinds: dict[str, Callable[..., list[Closure]]] = {
        "random": random_loops,
        "far": far_loops,
        "look-alike": look_alike_loops,
    }
    for name, of_seed in _kinds(arguments):
        graph = of_seed(arguments.first_seed)
        alone = len(np.unique(graph.robot)) == 1
        for robots in (2, 3, 5, 10) if alone else (0,):
            if robots and len(graph.robot) < 4 * robots:
                continue
            totals, worst, slowest, joined, joinable, runs = np.zeros(4, int), 1.0, 0.0, 0, 0, 0
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                graph = of_seed(seed)
                for share in (0.0, 0.1, 0.3, 0.5):
                    kind = list(kinds)[seed % len(kinds)]
                    of = team(graph.cut(robots) if robots else graph, seed, share, kinds[kind])
                    found = solved(of.odometry, of.closures)
                    totals += _counts(found.kept, of.true)
                    worst = max(worst, _against_clean(of, found.result))
                    slowest, joined, runs = max(slowest, found.seconds), joined + _whole(found.result), runs + 1
                    joinable += _joinable(of, checkable=True) == 1
            parts = f"in {robots}" if robots else "as it is"
            print(
                f"cut {name} {parts}, {runs} teams: {_shares(totals)} (goals 99 %, 0.2 %), one component in {joined}"
                f" (more than one closure holds {joinable} together), error at most {worst:.3f} x the clean"
                f" solution's (goal 1.05), at most {slowest:.1f} s (goal 10)",
                flush=True,
            )


def peers(arguments: argparse.Namespace) -> None:
    """The same teams, 30 % false, by PCM as published and by nothing but the robust estimate."""
    ways = {
        "groups": PcmSettings(noise=STATED, max_scale=MAX_SCALE),
        "PCM as published": PcmSettings(noise=STATED, method="clique"),
        "GNC alone": PcmSettings(noise=STATED, enabled=False),
    }
    for name, graph in _graphs(arguments):
        if len(graph.robot) > 2000:
            continue
        alone = len(np.unique(graph.robot)) == 1
        said = []
        for way, pcm in ways.items():
            totals, seconds, joined = np.zeros(4, int), 0.0, 0
            for seed in range(arguments.first_seed, arguments.first_seed + min(arguments.seeds, 3)):
                of = team(graph.cut(3) if alone else graph, seed, 0.3)
                found = solved(of.odometry, of.closures, pcm)
                totals += _counts(found.kept, of.true)
                seconds, joined = max(seconds, found.seconds), joined + _whole(found.result)
            said.append(f"{way}: {_shares(totals)}, one component in {joined}, {seconds:.1f} s")
        print(f"peers {name} in {3 if alone else 'its'} robots, 30 % false: {'; '.join(said)}", flush=True)


def sigmas(arguments: argparse.Namespace) -> None:
    """Standard deviations stated wrongly by one factor."""
    for factor in (0.1, 0.3, 1.0, 3.0, 10.0):
        totals, seconds = np.zeros(4, int), 0.0
        for _, graph in _graphs(arguments):
            if len(graph.robot) > 2000 or len(np.unique(graph.robot)) > 1 or len(graph.robot) < 100:
                continue
            wrong = replace(graph.cut(3), covariance=graph.covariance * factor**2)
            for seed in range(arguments.first_seed, arguments.first_seed + min(arguments.seeds, 3)):
                of = team(wrong, seed, 0.3)
                found = solved(of.odometry, of.closures)
                totals, seconds = totals + _counts(found.kept, of.true), seconds + found.seconds
        print(
            f"sigma stated {factor:g} times: {_shares(totals)} (goals 95 %, 0.5 %), {seconds:.1f} s in all", flush=True
        )


def unstated(arguments: argparse.Namespace) -> None:
    """Small graphs that state nothing: identity for all, 30 % of the loops false, between robots or within."""
    for kind, make in (("meadow", partial(meadow, poses=240)), ("grid", partial(grid, side=4))):
        for robots, false in ((1, own_loops), (2, own_loops), (2, random_loops), (3, random_loops)):
            totals, seconds = np.zeros(4, int), 0.0
            for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
                graph = make(seed)
                unknown = replace(graph.cut(robots), covariance=np.tile(np.eye(6), (len(graph.first), 1, 1)))
                of = team(unknown, seed, 0.3, false)
                found = solved(of.odometry, of.closures)
                totals, seconds = totals + _counts(found.kept, of.true), seconds + found.seconds
            where = "within robots" if false is own_loops else "between robots"
            print(
                f"unstated, small {kind} in {robots}, 30 % false {where}: {_shares(totals)}, {seconds:.1f} s in all",
                flush=True,
            )


def many(arguments: argparse.Namespace) -> None:
    """Large teams."""
    for robots, poses, closures in ((16, 200, 960), (100, 500, 20_000)):
        of = team(town(arguments.first_seed, robots, poses, int(0.8 * closures)), arguments.first_seed, 0.2)
        found = solved(of.odometry, of.closures)
        print(
            f"{robots} robots, {robots * poses} poses, {len(of.closures)} closures, 20 % false:"
            f" {_shares(_counts(found.kept, of.true))}, {len(found.result.components)} components (true closures make"
            f" {_joinable(of)}),"
            f" {found.seconds:.1f} s (goal {3 if robots == 16 else 60} s), {_peak_gb():.1f} GB (goal 4)",
            flush=True,
        )


def large(arguments: argparse.Namespace) -> None:
    """Graphs of thousands of poses and loops, half of all loops false and between robots."""
    _large(arguments, random_loops)


def own(arguments: argparse.Namespace) -> None:
    """The same with all false loops within robots."""
    _large(arguments, own_loops)


def _large(arguments: argparse.Namespace, false: Callable[..., list[Closure]]) -> None:
    for name, (make, robots) in LARGE.items():
        if arguments.graphs is not None and not any(word in name for word in arguments.graphs):
            continue
        of = team(make(arguments.first_seed).cut(robots), arguments.first_seed, 0.5, false)
        found = solved(of.odometry, of.closures)
        print(
            f"{name}, {len(of.graph.robot)} poses in {robots} robots, {len(of.closures)} closures, half of them false:"
            f" {_shares(_counts(found.kept, of.true))}, {len(found.result.components)} components,"
            f" {found.seconds:.1f} s (goal 10), {_peak_gb():.1f} GB",
            flush=True,
        )


def _peak_gb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6


# --------------------------------------------------------------------------------------------------- two robots, or few
def drawn(arguments: argparse.Namespace) -> None:
    """True closures with their stated noise; random ones; look-alike ones."""
    graphs = max(arguments.seeds, 5) * 10
    for robots in (2, 5):
        for count in (3, 10, 30, 100, 200):
            shares = [
                _share_kept(*_wanderers(seed, robots, count))
                for seed in range(arguments.first_seed, arguments.first_seed + graphs)
            ]
            print(
                f"{count} true closures per joined pair of {robots} robots, {graphs} graphs: accepted in"
                f" {np.mean(np.array(shares) > 0):.1%} (goal 99 %), {np.mean(shares):.1%} of closures (goal 97 %)",
                flush=True,
            )
            graphs = max(10, graphs // 2)
        graphs = max(arguments.seeds, 5) * 10
    for count in (2, 5, 10, 30, 100, 400):
        bad = sum(
            _share_kept(*_unrelated(seed, count)) > 0
            for seed in range(arguments.first_seed, arguments.first_seed + graphs)
        )
        print(f"{count} random closures, {graphs} graphs: something accepted in {bad} (goal 1 %)", flush=True)
    for count in (3, 5, 8):
        bad = sum(
            _share_kept(*_look_alike(seed, count)) > 0
            for seed in range(arguments.first_seed, arguments.first_seed + graphs)
        )
        print(f"{count} closures of one look-alike place, {graphs} graphs: accepted in {bad} (goal 0)", flush=True)


def cycle(arguments: argparse.Namespace) -> None:
    """A wrong set of 10 between A and B, right ones of 5 for A-C and B-C."""
    for place in (True, False):
        wrong, right = [], []
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.seeds):
            odometry, truth, rng = _paths(seed, 3)
            shift = se3.from_yaw(0.4, np.array([20.0, 5.0, 0.0]))
            ends = [(20 + n, 60 + n) if place else tuple(rng.integers(0, 120, 2)) for n in range(10)]
            closures = [_measured(rng, truth, "r0", "r1", i, j, shift) for i, j in ends]
            for a, b in (("r0", "r2"), ("r1", "r2")):
                closures += [_measured(rng, truth, a, b, *rng.integers(0, 120, 2)) for _ in range(5)]
            kept = solved(odometry, closures).kept
            wrong.append(kept[:10].any())
            right.append(kept[10:].mean())
        where = "at one place" if place else "all along"
        print(
            f"a wrong set of 10 {where} against right sets of 5 over a third robot: stands in {sum(wrong)} of"
            f" {len(wrong)} (goal 0), {np.mean(right):.0%} of the right ones kept",
            flush=True,
        )


def short(arguments: argparse.Namespace) -> None:
    """Paths of 20 m; four true closures and four false ones between each two robots, as in `pcm_spoiled`."""
    for robots, teams in ((2, 10 * arguments.seeds), (4, arguments.seeds), (8, 2), (16, 1)):
        totals, seconds = np.zeros(4, int), 0.0
        for seed in range(arguments.first_seed, arguments.first_seed + teams):
            odometry, closures, true = _short_paths(seed, robots)
            found = solved(odometry, closures)
            totals, seconds = totals + _counts(found.kept, true), max(seconds, found.seconds)
        print(
            f"{teams} teams of {robots} on short paths, 4 true and 4 false a pair: {_shares(totals)}, {seconds:.1f} s",
            flush=True,
        )


def _short_paths(seed: int, robots: int) -> tuple[dict[str, Trajectory], list[Closure], BoolArray]:
    """Steps of a metre in random directions of space, three in ten of them turns."""
    rng, odometry, truth, closures = np.random.default_rng(seed), {}, {}, []
    covariance = np.tile(np.diag(SIGMA**2), (20, 1, 1))
    stamps_ns = np.arange(21, dtype=np.int64) * 10**9
    for n in range(robots):
        steps = np.tile(np.eye(4), (20, 1, 1))
        turns = np.flatnonzero(rng.random(20) < 0.3)
        steps[turns] = np.stack([np.eye(4), *(random_pose(rng, 0.0) for _ in turns)])[1:]
        steps[:, :3, 3] = [1.0, 0.0, 0.0]
        truth[f"r{n}"] = _chain(random_pose(rng, 2.0), steps)
        measured = steps @ se3.exp(rng.normal(size=(20, 6)) * SIGMA)
        odometry[f"r{n}"] = Trajectory(f"r{n}", stamps_ns, _chain(np.eye(4), measured), step_covariances=covariance)
    for a, b in combinations(odometry, 2):
        ends = rng.integers(0, 21, (8, 2))
        closures += [_measured(rng, truth, a, b, i, j) for i, j in ends[:4]]
        closures += [_closure(a, i, b, j, random_pose(rng, 3.0)) for i, j in ends[4:]]
    return odometry, closures, np.tile(np.arange(8) < 4, len(closures) // 8)


def _wanderers(seed: int, robots: int, count: int) -> tuple[dict[str, Trajectory], list[Closure]]:
    """Robots in a chain, `count` closures between each two neighbours."""
    odometry, truth, rng = _paths(seed, robots)
    pairs = [(f"r{n}", f"r{n + 1}") for n in range(robots - 1)]
    return odometry, [_measured(rng, truth, a, b, *rng.integers(0, 120, 2)) for a, b in pairs for _ in range(count)]


def _unrelated(seed: int, count: int) -> tuple[dict[str, Trajectory], list[Closure]]:
    odometry, _, rng = _paths(seed, 2)
    T = se3.from_yaw(rng.uniform(-np.pi, np.pi, count), rng.normal(0, [10.0, 10.0, 1.0], (count, 3)))
    ends = rng.integers(0, 120, (count, 2)).tolist()
    return odometry, [_closure("r0", i, "r1", j, T_ab) for (i, j), T_ab in zip(ends, T, strict=True)]


def _look_alike(seed: int, count: int) -> tuple[dict[str, Trajectory], list[Closure]]:
    """Neighbouring keyframes of two places that look alike: all agree on one wrong alignment."""
    odometry, truth, rng = _paths(seed, 2)
    i, j = rng.integers(0, 120 - count, 2)
    offset = se3.from_yaw(rng.uniform(-np.pi, np.pi), rng.normal(0, [1.0, 1.0, 0.1]))
    shift = truth["r0"][i] @ offset @ se3.inverse(truth["r1"][j])
    return odometry, [_measured(rng, truth, "r0", "r1", i + n, j + n, shift) for n in range(count)]


def _paths(seed: int, robots: int) -> tuple[dict[str, Trajectory], dict[str, FloatArray], np.random.Generator]:
    """Paths of 120 m in one field, odometry with errors as its model expects, each in its own frame."""
    rng, odometry, truth = np.random.default_rng(seed), {}, {}
    for n in range(robots):
        tangents = np.zeros((119, 6))
        tangents[:, 2], tangents[:, 3] = rng.normal(0, 0.1, 119) + rng.normal(0, 0.02), 1.0
        start = se3.from_yaw(rng.uniform(-np.pi, np.pi), np.array([*rng.uniform(-20, 20, 2), 0.0]))
        sigma = np.repeat([0.002, 0.046], 3)
        steps = se3.exp(tangents)
        measured = steps @ se3.exp(rng.normal(size=(119, 6)) * sigma)
        truth[f"r{n}"] = _chain(start, steps)
        covariance = np.tile(np.diag(sigma**2), (119, 1, 1))
        stamps_ns = np.arange(120, dtype=np.int64) * 10**9
        odometry[f"r{n}"] = Trajectory(f"r{n}", stamps_ns, _chain(np.eye(4), measured), step_covariances=covariance)
    return odometry, truth, rng


def _chain(start: FloatArray, steps: FloatArray) -> FloatArray:
    poses = [start]
    for step in steps:
        poses.append(poses[-1] @ step)
    return np.stack(poses)


def _measured(
    rng: np.random.Generator,
    truth: dict[str, FloatArray],
    a: str,
    b: str,
    i: int,
    j: int,
    shift: FloatArray | None = None,
) -> Closure:
    """With noise; of b as if its whole frame were moved by `shift`."""
    T_b = truth[b][j] if shift is None else shift @ truth[b][j]
    return _closure(a, i, b, j, se3.between(truth[a][i], T_b) @ se3.exp(rng.normal(size=6) * SIGMA))


def _closure(a: str, i: int, b: str, j: int, T: FloatArray) -> Closure:
    return Closure.from_measurement(KeyframeId(a, int(i)), KeyframeId(b, int(j)), T, np.diag(SIGMA**2))


def _share_kept(odometry: dict[str, Trajectory], closures: list[Closure]) -> float:
    return float(solved(odometry, closures).kept.mean())


# -------------------------------------------------------------------------------------------------------------- figures
def _kinds(arguments: argparse.Namespace) -> Iterator[tuple[str, Callable[[int], Graph]]]:
    """Those that `--graphs` names, and the graph of a seed: files by their name, made ones by their kind."""
    for name in FILES:
        if arguments.graphs is None or any(word in name for word in arguments.graphs):
            graph = read(name)
            yield name, lambda _, graph=graph: graph  # type: ignore[misc]
    for kind, make in (MADE | HELD_OUT).items():
        if arguments.graphs is None or any(word in kind for word in arguments.graphs):
            yield kind, make


def _graphs(arguments: argparse.Namespace) -> Iterator[tuple[str, Graph]]:
    """The graph of the first seed of each."""
    yield from ((name, of_seed(arguments.first_seed)) for name, of_seed in _kinds(arguments))


def _counts(kept: BoolArray, true: BoolArray) -> np.ndarray:
    return np.array([kept[true].sum(), true.sum(), kept[~true].sum(), (~true).sum()])


def _shares(totals: np.ndarray) -> str:
    kept, true, bad, false = totals
    return f"{kept} of {true} true kept ({kept / max(true, 1):.2%}), {bad} of {false} false"


def _whole(result: GraphResult) -> bool:
    return len(result.components) == 1


def _joinable(of: CutTeam, *, checkable: bool = False) -> int:
    """Components that the true closures make; `checkable`: without single ones that nothing else can confirm."""
    joined: nx.Graph[str] = nx.Graph()
    joined.add_nodes_from(of.odometry)
    true = (c for c, is_true in zip(of.closures, of.true, strict=True) if is_true)
    count = Counter(frozenset((c.query.robot, c.match.robot)) for c in true)
    joined.add_edges_from((a, b) for a, b in combinations(of.odometry, 2) if count[frozenset((a, b))])
    if checkable:
        joined.remove_edges_from([ends for ends in nx.bridges(joined) if count[frozenset(ends)] == 1])  # type: ignore[misc]
    return nx.number_connected_components(joined)


def _against_clean(of: CutTeam, result: GraphResult) -> float:
    """Error against truth by that of least squares over the true closures; without truth 1 + their distance by size."""
    clean = optimise(
        of.odometry,
        [c for c, true in zip(of.closures, of.true, strict=True) if true],
        PoseGraphSettings(noise=STATED, robust="none"),
    )
    ours, best = (np.concatenate([r.trajectories[name].positions for name in of.odometry]) for r in (result, clean))
    if of.graph.truth is None:
        return 1.0 + _apart(ours, best) / float(np.linalg.norm(best.std(axis=0)))
    truth = of.graph.truth[:, :3, 3]
    return _apart(ours, truth) / _apart(best, truth)


def _apart(one: FloatArray, other: FloatArray) -> float:
    """Root mean square distance, m, after the rigid motion that makes it least."""
    a, b = one - one.mean(axis=0), other - other.mean(axis=0)
    U, _, Vt = np.linalg.svd(b.T @ a)
    R = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    return float(np.sqrt(np.mean(np.sum((a @ R.T - b) ** 2, axis=1))))


ROWS: dict[str, Callable[[argparse.Namespace], None]] = {
    "whole": whole,
    "cut": cut,
    "peers": peers,
    "sigmas": sigmas,
    "unstated": unstated,
    "drawn": drawn,
    "cycle": cycle,
    "short": short,
    "many": many,
    "large": large,
    "own": own,
}
