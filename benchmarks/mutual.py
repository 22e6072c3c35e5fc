"""Whole runs whose radio has one systematic error: is the map ever worse for having a radio, and is the radio named?

    python benchmarks/mutual.py [--data demo-site,city-0.9] [--faults feet,reversed] [--seed 1] [--beyond]
        [--random 9] [--correct] [--presets small-site,disco-park]

Each data set is read once; its odometry and registrations are shared by all runs.  A fault changes the log only, so
that `none` is the same for all of them.  A row says: error of the map (team, m), robots connected, accepted closures
and how many of them are false, whether a sentence of the diagnosis names the radio as the likely fault, and whether the
map is said to be in doubt.  `worse` marks rows whose error is above 1.05 times that of `none` (and by more than 5 cm),
or that connect fewer robots.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from mutual_faults import BEYOND, FAULTS, Fault, drawn

from wiclosure.pipeline.config import Config, load_config
from wiclosure.pipeline.data.inputs import Inputs, RobotInput
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.runtime.cache import StageCache, default_cache_folder
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.stages.run import candidate_filter, prepare, run_stages
from wiclosure.pipeline.stages.run_result import RunResult
from wiclosure.simulation.sensors.radio import RadioSettings, simulate_wireless_from_poses
from wiclosure.types import Scan, Trajectory

RECORDED = Path(os.environ.get("WICLOSURE_DATA", "../shared/data")) / "kitti_raw_0926_0005" / "scans.npz"
LIMIT, SLACK_M = 1.05, 0.05
NAMED = (
    "the likely fault",
    "the radio may be at fault",
    "--accept-correction",
    "systematic error beyond the usual: azimuth",
    "systematic error beyond the usual: range",
    "systematic error beyond the usual: clock",
)


# Data --------------------------------------------------------------------------------------------------------------


SCENARIOS: Mapping[str, str] = {
    "demo-site": "scenario:demo-site",
    "shell-space": "scenario:shell-space",
    "city-0.3": "scenario:city,aliasing=0.3",
    "city-0.9": "scenario:city,aliasing=0.9",
    "static-mirror": "scenario:static-mirror",
    "campus": "scenario:campus",
}


@dataclass(frozen=True)
class Scans:
    """Scans in memory."""

    scans: tuple[Scan, ...]
    description: str = "part of a recorded drive"

    def __len__(self) -> int:
        return len(self.scans)

    def __iter__(self) -> Iterator[Scan]:
        return iter(self.scans)


def recorded(seed: int) -> Inputs:
    """The first and the last 3/5 of KITTI drive 0926_0005 as two robots that start together; radio from its poses."""
    with np.load(RECORDED) as pack:
        poses, stamps_ns = pack["poses"], np.rint(pack["stamps"] * 1e9).astype(np.int64)
        xyz, offsets, scale = pack["xyz"], pack["offsets"], float(pack["scale"])
    parts = {"alpha": (np.arange(0, 95, 2), 0), "beta": (np.arange(61, 154, 2), -6_000_000_000)}
    truth, robots = {}, []
    for robot, (rows, later_ns) in parts.items():
        truth[robot] = Trajectory(robot, stamps_ns[rows] + later_ns, poses[rows])
        clouds = (np.ascontiguousarray(xyz[:, offsets[i] : offsets[i + 1]].T * scale) for i in rows)
        scans = tuple(Scan(int(t), c) for t, c in zip(truth[robot].stamps_ns, clouds, strict=True))
        robots.append(RobotInput(robot, Scans(scans), ["mutual", robot], truth[robot]))
    radio = RadioSettings(every_m=4.0, direction="reciprocal", paths=5)
    return Inputs(tuple(robots), simulate_wireless_from_poses(truth, radio, seed=seed))


def inputs_of(name: str, seed: int) -> Inputs:
    """A data set of that name."""
    return recorded(seed) if name == "kitti-0005" else open_inputs([_seeded(SCENARIOS[name], seed)])


def _seeded(scenario: str, seed: int) -> str:
    return f"{scenario},seed={seed}"


# Runs --------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Outcome:
    """What a row shows."""

    ate_m: float
    connected: int
    accepted: int
    false: int
    named: bool
    doubt: bool
    seconds: float

    @classmethod
    def of(cls, result: RunResult, seconds: float) -> Outcome:
        """Of a run.  Where robots are apart, the error is that of the largest component."""
        metrics = result.metrics
        largest = max(metrics["components"], key=lambda c: len(c["robots"]))
        ate_m = metrics["ate_m"].get("team") or largest["ate_m"] or float("nan")
        named = any(words in sentence for sentence in metrics["diagnosis"] for words in NAMED)
        closures, doubt = metrics["closures"], bool(metrics["doubts"])
        accepted, false = closures["accepted"], closures["accepted_false"] or 0
        return cls(ate_m, len(largest["robots"]), accepted, false, named, doubt, seconds)

    def worse_than(self, other: Outcome) -> bool:
        """Whether this map is worse, or has fewer robots."""
        return self.connected < other.connected or self.ate_m > max(LIMIT * other.ate_m, other.ate_m + SLACK_M)


def configured(presets: Sequence[str] = ("strong",), *, correct: bool) -> Config:
    """Presets laid over each other."""
    return load_config(*presets, overrides=[f"filter.accept_correction={str(correct).lower()}"])


def main() -> None:
    """Prints the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", default=",".join([*SCENARIOS, "kitti-0005"]))
    parser.add_argument("--faults", default="", help="only those whose name holds one of these words, comma separated")
    parser.add_argument("--beyond", action="store_true", help="faults that nothing was written for")
    parser.add_argument(
        "--random", type=int, default=0, help="so many faults, drawn by the seed: two, in part, half-way"
    )
    parser.add_argument("--correct", action="store_true", help="with --accept-correction")
    parser.add_argument("--presets", default="strong", help="each laid over those before it, comma separated")
    parser.add_argument("--seed", type=int, default=1, help="of the simulated world")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--show", action="store_true", help="print the diagnosis of every run")
    arguments = parser.parse_args()
    words = [word for word in arguments.faults.split(",") if word]
    faults = drawn(arguments.random, arguments.seed) if arguments.random else BEYOND if arguments.beyond else FAULTS
    heads = f"{'closures':>8} {'false':>5} {'named':>5} {'doubt':>5} {'s':>6}"
    print(f"{'data':14} {'run':40} {'ATE m':>7} {'robots':>6} {heads}")
    for name in arguments.data.split(","):
        config = configured(arguments.presets.split(","), correct=arguments.correct)
        inputs, progress = inputs_of(name, arguments.seed), NoProgress()
        cache = StageCache(default_cache_folder())
        prepared = prepare(inputs, config, cache=cache, jobs=arguments.jobs, progress=progress)
        runs: dict[str, tuple[str, Fault]] = {"none": ("none", FAULTS["honest"])}
        chosen = [fault for fault in faults if not words or any(word in fault for word in words)]
        runs |= {fault: ("wiclosure", faults[fault]) for fault in chosen}
        without: Outcome | None = None
        for label, (filter_name, spoil) in runs.items():
            spoilt = replace(inputs, wireless=spoil(inputs.wireless))
            if label not in {"honest", "none"} and spoilt.wireless == inputs.wireless:
                continue
            began = time.perf_counter()
            result = run_stages(
                replace(prepared, inputs=spoilt), candidate_filter(filter_name, spoilt, config), progress=progress
            )
            outcome = Outcome.of(result, time.perf_counter() - began)
            without = without or outcome
            print(
                f"{name:14} {label:40} {outcome.ate_m:7.2f} {outcome.connected:6d} {outcome.accepted:8d}"
                f" {outcome.false:5d} {'yes' if outcome.named else '':>5} {'yes' if outcome.doubt else '':>5}"
                f" {outcome.seconds:6.1f}"
                f" {'worse' if outcome.worse_than(without) else ''}",
                flush=True,
            )
            if arguments.show:
                print(*(f"    {sentence}" for sentence in result.metrics["diagnosis"]), sep="\n")


if __name__ == "__main__":
    main()
