"""Large teams, and the same run on a cluster.

    python benchmarks/fleet.py [--rows filter,overhead,efficiency,killed,memory] [--robots 10,30,100] [--jobs 1]
        [--scenario demo-site] [--scans 60] [--kills 10] [--seed 0] [--csv docs/scaling.csv]

`filter`: robots with 500 keyframes each in a plan of a city that grows with them, four links for each robot, 20
measurements a link (`fleet_world.py`); each size in a fresh process, and added to the table `--csv`, from which
`docs/scaling_picture.py` draws. Processor time and memory are those of all processes together. The other rows run a
simulated scenario, each run with an empty cache: `overhead` of `--cluster local:2` against `-j 2`; `efficiency` of
two one-core workers against one; `killed`: a worker killed at random moments of a run; `memory` of this process while
odometry is done by workers, for so many scans and for half of them.
"""

from __future__ import annotations

import argparse
import csv
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import psutil
from fleet_world import fleet

from wiclosure import se3
from wiclosure.memory import peak_rss_mb
from wiclosure.pipeline.config import load_config
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.cluster.connection import cluster
from wiclosure.pipeline.runtime.cluster.tasks import Cluster
from wiclosure.pipeline.runtime.processes import local_workers
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.odometry import front_ends
from wiclosure.pipeline.stages.run import candidate_filter, prepare, run_stages
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.types import FilterResult, Trajectory
from wiclosure.wiclosure_filter.config import FilterSettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.workers import Workers

CONFIG = "small-site"


def load() -> str:
    return f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"


COLUMNS = ("robots", "jobs", "links", "meeting", "wall_s", "processor_s", "peak_mb", "kept", "total", "recall")


def filter_of_a_fleet(robots: int, jobs: int, seed: int, table: Path | None) -> None:
    """One row; in a process of its own, for its peak of memory."""
    team = fleet(robots, seed=seed)
    links = {(m.receiver, m.transmitter) for m in team.wireless.measurements}
    # Of a robot that nothing joins for certain every pair would be kept, with all robots.
    settings = FilterSettings(on_ambiguous="reject")
    chosen = WiClosureFilter(settings, local_workers(jobs))
    began, spent = time.perf_counter(), processor_s()
    with memory_watched() as together_mb:
        result = chosen.candidates(team.odometry, team.wireless)
        seconds, spent = time.perf_counter() - began, processor_s() - spent
    meeting = sum(len(pairs) > 0 for pairs in result.pairs if pairs.predicts is not None)
    peak_mb = max(together_mb) if jobs > 1 else peak_rss_mb() or max(together_mb)
    print(
        f"{robots:5d} robots, {len(links):5d} links, {sum(not a.ambiguous for a in result.alignments):5d} certain,"
        f" {meeting:5d} pairs of robots meet: {seconds:7.1f} s ({spent:7.1f} s of processor time,"
        f" {1e3 * spent / max(meeting, 1):6.1f} ms a meeting pair), peak {peak_mb:6.0f} MB; {load()}",
        flush=True,
    )
    kept_share = recall(result, team.truth)
    print(
        f"{robots:5d} robots: {result.pairs_kept} of {result.pairs_total} pairs kept, recall {kept_share:.4f},"
        f" {100 * held(result, team.truth):.1f} % within their 90 % regions",
        flush=True,
    )
    if table is not None:
        measured = (f"{seconds:.1f}", f"{spent:.1f}", f"{peak_mb:.0f}")
        row = (robots, jobs, len(links), meeting, *measured, result.pairs_kept, result.pairs_total, f"{kept_share:.4f}")
        new = not table.exists()
        with table.open("a", encoding="utf-8", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([COLUMNS, row] if new else [row])


def processes() -> list[psutil.Process]:
    """This one and its workers."""
    own = psutil.Process()
    return [own, *own.children(recursive=True)]


def processor_s() -> float:
    """Of this process, of those that it began and that have ended, and of workers that live."""
    spent = 0.0
    for process in processes():
        with suppress(psutil.NoSuchProcess):
            times = process.cpu_times()
            spent += times.user + times.system + times.children_user + times.children_system
    return spent


@contextmanager
def memory_watched(every_s: float = 0.1) -> Iterator[list[float]]:
    """Memory of this process and its workers together, MB, each moment; pages that they share count for each."""
    seen, over = [0.0], threading.Event()

    def watch() -> None:
        while not over.wait(every_s):
            now = 0
            for process in processes():
                with suppress(psutil.NoSuchProcess):
                    now += process.memory_info().rss
            seen.append(now / 1e6)

    watching = threading.Thread(target=watch)
    watching.start()
    try:
        yield seen
    finally:
        over.set()
        watching.join()


def recall(result: FilterResult, truth: Mapping[str, Trajectory], true_m: float = 35.0) -> float:
    """Share of the pairs truly within the sensor's range that are kept, of robots that links join."""
    boxes = {robot: (t.positions.min(axis=0), t.positions.max(axis=0)) for robot, t in truth.items()}
    true = kept = 0
    for pairs in result.pairs:
        if pairs.predicts is None:
            continue
        a, b = truth[pairs.robot_a].positions, truth[pairs.robot_b].positions
        (low_a, high_a), (low_b, high_b) = boxes[pairs.robot_a], boxes[pairs.robot_b]
        if np.linalg.norm(np.maximum(np.maximum(low_a - high_b, low_b - high_a), 0.0)) > true_m:
            continue
        near = np.linalg.norm(a[:, None] - b[None], axis=2) <= true_m
        true, kept = true + int(near.sum()), kept + int(near[pairs.index_a, pairs.index_b].sum())
    return kept / max(true, 1)


def held(
    result: FilterResult, truth: Mapping[str, Trajectory], *, share: float = 0.9, of_each: int = 20, most: int = 500
) -> float:
    """Share of kept pairs' horizontal displacements within their stated regions, of some of so many pairs of robots.

    Not of all: a prediction's covariance takes as long as the search of two robots.
    """
    rng, within = np.random.default_rng(0), [np.zeros(0, bool)]
    meeting = [pairs for pairs in result.pairs if len(pairs) and pairs.predicts is not None]
    for pairs in meeting[:: -(-len(meeting) // most) or 1]:
        chosen = rng.integers(len(pairs), size=of_each) if len(pairs) else np.zeros(0, np.int64)
        if (predicted := pairs.predicted(chosen)) is not None:
            T_a_b, covariance = predicted
            a = truth[pairs.robot_a].poses[pairs.index_a[chosen]]
            b = truth[pairs.robot_b].poses[pairs.index_b[chosen]]
            off = np.einsum("mji,mj->mi", T_a_b[:, :3, :3], se3.between(a, b)[:, :3, 3] - T_a_b[:, :3, 3])[:, :2]
            whitened = np.linalg.solve(covariance[:, 3:5, 3:5], off[:, :, None])[:, :, 0]
            within.append(np.einsum("mi,mi->m", off, whitened) <= -2.0 * np.log(1.0 - share))
    return float(np.concatenate(within).mean())


def whole_run(scenario: str, scans: int, jobs: int, workers: Workers | None = None) -> tuple[RunResult, float]:
    """A run from nothing, and the seconds that it takes."""
    config = load_config(CONFIG)
    with tempfile.TemporaryDirectory() as folder:
        cache = StageCache(Path(folder))
        began = time.perf_counter()
        inputs = open_inputs([f"scenario:{scenario}"], limit=scans)
        chosen = candidate_filter("wiclosure", inputs, config, workers)
        prepared = prepare(inputs, config, cache=cache, jobs=jobs, progress=NoProgress(), cluster=workers)
        result = run_stages(prepared, chosen, progress=NoProgress())
        return result, time.perf_counter() - began


def same(one: RunResult, other: RunResult) -> bool:
    return all(np.array_equal(one.merged[robot].poses, other.merged[robot].poses) for robot in one.merged) and all(
        (a.query, a.match, a.rejected_at) == (b.query, b.match, b.rejected_at)
        for a, b in zip(one.solution.closures, other.solution.closures, strict=True)
    )


def overhead(scenario: str, scans: int) -> None:
    here, seconds = whole_run(scenario, scans, 2)
    began = time.perf_counter()
    with cluster("local:2") as workers:
        start = time.perf_counter() - began
        there, on_cluster = whole_run(scenario, scans, 1, workers)
    print(
        f"{scenario}, {scans} scans a robot: -j 2 {seconds:.1f} s, --cluster local:2 {on_cluster:.1f} s"
        f" ({on_cluster / seconds:.2f} x) after {start:.1f} s of starting it; same result: {same(here, there)};"
        f" {workers.costs.bytes_moved / 1e6:.1f} MB moved; {load()}"
    )


def efficiency(scenario: str, scans: int) -> None:
    seconds = {}
    for count in (1, 2):
        with cluster(f"local:{count}") as workers:
            seconds[count] = whole_run(scenario, scans, 1, workers)[1]
    print(
        f"{scenario}, {scans} scans a robot: one worker {seconds[1]:.1f} s, two {seconds[2]:.1f} s,"
        f" efficiency {seconds[1] / (2 * seconds[2]):.2f}; {load()}"
    )


def killed(scenario: str, scans: int, kills: int, seed: int) -> None:
    """One line for each kill as it comes: what is lost, and whether the result is the same to the last bit."""
    chance, undisturbed, seconds = random.Random(seed), None, 0.0
    for kill in range(kills):
        with cluster("local:2") as workers:
            whole_run(scenario, scans, 1, workers)  # workers import what they need
            if undisturbed is None:
                undisturbed, seconds = whole_run(scenario, scans, 1, workers)
                print(f"{scenario}, {scans} scans a robot: {seconds:.1f} s undisturbed; {load()}", flush=True)
            after_s = chance.uniform(0.0, 0.9 * seconds)
            with _killing(workers, after_s):
                disturbed, took = whole_run(scenario, scans, 1, workers)
            print(
                f"{kill + 1}: a worker killed after {after_s:.1f} s: {took - seconds:.1f} s lost,"
                f" {workers.costs.retries} tasks begun again, same result: {same(undisturbed, disturbed)}; {load()}",
                flush=True,
            )


@contextmanager
def _killing(workers: Cluster, after_s: float) -> Iterator[None]:
    pids = list(workers.process_ids().values())
    timer = threading.Timer(after_s, lambda: os.kill(pids[0], signal.SIGKILL))
    timer.start()
    yield
    timer.join()


def memory(scenario: str, scans: int) -> None:
    """Growth of this process while workers follow scans: results stay in the cache until all are there."""
    config = load_config(CONFIG)
    with cluster("local:2") as workers, tempfile.TemporaryDirectory() as folder:
        for count in (scans // 2, scans):
            inputs = open_inputs([f"scenario:{scenario}"], limit=count)
            before, moved = peak_rss_mb(), workers.costs.bytes_moved
            front_ends(
                inputs.robots, config, cache=StageCache(Path(folder)), jobs=1, progress=NoProgress(), workers=workers
            )
            moved = workers.costs.bytes_moved - moved
            print(
                f"{scenario}, {count} scans a robot: peak of this process {before:.0f} -> {peak_rss_mb():.0f} MB,"
                f" {moved / 1e6:.2f} MB moved; {load()}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rows", default="filter,overhead,efficiency,killed,memory")
    parser.add_argument("--robots", default="10,30,100")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--scenario", default="demo-site")
    parser.add_argument("--scans", type=int, default=60)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--csv", type=Path)
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one is not None:
        filter_of_a_fleet(arguments.one, arguments.jobs, arguments.seed, arguments.csv)
        return
    rows = arguments.rows.split(",")
    if "filter" in rows:
        for robots in arguments.robots.split(","):
            own = ["--one", robots, "--jobs", str(arguments.jobs), "--seed", str(arguments.seed)]
            own += ["--csv", str(arguments.csv)] if arguments.csv else []
            subprocess.run([sys.executable, __file__, *own], check=True)
    if "overhead" in rows:
        overhead(arguments.scenario, arguments.scans)
    if "efficiency" in rows:
        efficiency(arguments.scenario, arguments.scans)
    if "killed" in rows:
        killed(arguments.scenario, arguments.scans, arguments.kills, arguments.seed)
    if "memory" in rows:
        memory(arguments.scenario, arguments.scans)


if __name__ == "__main__":
    main()
