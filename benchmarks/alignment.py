"""Monte Carlo of frame alignment: robots in a 25 m area, a handful of measurements of five paths each.

    python benchmarks/alignment.py [--trials 300] [--seed 1]

Prints, for each kind of heading knowledge, how often the frame is found (mean error below 4 m where robot b went), how
often the answer is called certain, and how often a certain answer is wrong; then how often a few alignments are left
instead, and how often all of them are wrong.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.types import (
    AlignmentHypothesis,
    AoaPath,
    FloatArray,
    Heading,
    Trajectory,
    WirelessLog,
    WirelessMeasurement,
)
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks

AREA_M = 25.0
FOUND_M = 4.0


@dataclass(frozen=True)
class Radio:
    """What is simulated."""

    measurements: int = 4
    paths: int = 5
    direct: float = 1.0  # probability that the direct path is among them
    aoa_sigma: float = np.radians(10.0)
    range_sigma: float = 0.5
    range_outlier: float = 0.0
    range_bias: float = 0.0  # probability of 0-3 m too much


@dataclass(frozen=True, eq=False)
class Trial:
    """Two robots, what they heard, and the truth."""

    trajectories: dict[str, Trajectory]
    wireless: WirelessLog
    T_a_b: FloatArray


def walk(rng: np.random.Generator, poses: int = 120, step: float = 0.4) -> FloatArray:
    """A robot that wanders inside the area: `T_world_body (N, 4, 4)`."""
    position, yaw, turn = rng.uniform(3, AREA_M - 3, 2), rng.uniform(-np.pi, np.pi), 0.0
    out = np.tile(np.eye(4), (poses, 1, 1))
    for k in range(poses):
        out[k] = se3.from_yaw(yaw, np.array([*position, 0.0]))
        to_centre = np.arctan2(*(AREA_M / 2 - position)[::-1])
        outside = np.any((position < 3) | (position > AREA_M - 3))
        turn = 0.9 * turn + rng.normal(0, 0.06)
        yaw += 0.4 * np.sin(to_centre - yaw) if outside else turn
        position = position + step * np.array([np.cos(yaw), np.sin(yaw)])
    return out


def paths(rng: np.random.Generator, azimuth: float, radio: Radio) -> tuple[AoaPath, ...]:
    """The direct path, if it is there, among false ones; nothing tells them apart."""
    azimuths = rng.uniform(-np.pi, np.pi, radio.paths)
    if rng.random() < radio.direct:
        azimuths[rng.integers(radio.paths)] = azimuth + rng.normal(0, radio.aoa_sigma)
    return tuple(AoaPath(float(a), radio.aoa_sigma, 1.0 / radio.paths) for a in azimuths)


def measure_range(rng: np.random.Generator, distance: float, radio: Radio) -> float:
    """A range with its errors."""
    if rng.random() < radio.range_outlier:
        return float(rng.uniform(0, 2 * AREA_M))
    bias = rng.uniform(0, 3) if rng.random() < radio.range_bias else 0.0
    return max(0.0, distance + bias + rng.normal(0, radio.range_sigma))


def make_trial(rng: np.random.Generator, knowledge: str, radio: Radio) -> Trial:
    """One random situation."""
    world = {name: walk(rng) for name in ("a", "b")}
    stamps = np.arange(120) * 500_000_000
    T_world_odom = {n: se3.from_yaw(rng.uniform(-np.pi, np.pi), rng.uniform(-30, 30, 3) * [1, 1, 0]) for n in world}
    trajectories = {n: Trajectory(n, stamps, se3.inverse(T_world_odom[n]) @ world[n]) for n in world}
    measurements, headings = [], []
    for index in np.sort(rng.choice(120, radio.measurements, replace=False)):
        ways = [("a", "b"), ("b", "a")] if knowledge == "reciprocal" else [("a", "b")]
        distance = float(np.linalg.norm(world["a"][index, :3, 3] - world["b"][index, :3, 3]))
        ranged = measure_range(rng, distance, radio)
        for receiver, transmitter in ways:
            seen = (se3.inverse(world[receiver][index]) @ world[transmitter][index])[:3, 3]
            heard = () if knowledge == "range-only" else paths(rng, float(np.arctan2(seen[1], seen[0])), radio)
            m = WirelessMeasurement(int(stamps[index]), receiver, transmitter, ranged, radio.range_sigma, heard)
            measurements.append(m)
            if knowledge == "heading":
                headings += [
                    Heading(int(stamps[index]), n, float(se3.yaw(world[n][index]) + rng.normal(0, 0.05)), 0.05)
                    for n in world
                ]
    return Trial(
        trajectories,
        WirelessLog(tuple(measurements), tuple(headings)),
        se3.between(T_world_odom["a"], T_world_odom["b"]),
    )


def is_right(alignment: AlignmentHypothesis | None, trial: Trial) -> bool:
    """Whether robot b went where the alignment says, within a few metres on average."""
    if alignment is None:
        return False
    b = trial.trajectories["b"].positions
    error_m = np.linalg.norm(se3.transform(alignment.T_a_b, b) - se3.transform(trial.T_a_b, b), axis=1).mean()
    return bool(error_m < FOUND_M)


def run(knowledge: str, radio: Radio, trials: int, seed: int, settings: AlignmentSettings) -> dict[str, float]:
    """Many trials: the shares of the table (of all trials), and milliseconds an alignment."""
    rng = np.random.default_rng(seed)
    found, certain, wrong, few, few_wrong, seconds = 0, 0, 0, 0, 0, 0.0
    for _ in range(trials):
        trial = make_trial(rng, knowledge, radio)
        begin = time.perf_counter()
        links = TeamLinks.of(trial.trajectories, trial.wireless, GatheringLimits.of(settings))
        result = align(links.by_pair["a", "b"], trial.trajectories, settings)
        seconds += time.perf_counter() - begin
        right = is_right(result.best, trial)
        found += right
        certain += not result.ambiguous
        wrong += not result.ambiguous and not right
        few += bool(result.likely_alternatives)
        few_wrong += (
            bool(result.likely_alternatives)
            and not right
            and not any(is_right(other, trial) for other in result.likely_alternatives)
        )
    return {
        "found": found / trials,
        "certain": certain / trials,
        "wrong": wrong / trials,
        "few": few / trials,
        "few_wrong": few_wrong / trials,
        "milliseconds": 1000 * seconds / trials,
    }


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--multipath", default="consensus", choices=["consensus", "pcm"])
    parser.add_argument("--measurements", type=int, nargs="+", default=[4, 8])
    arguments = parser.parse_args()
    settings = AlignmentSettings(multipath=arguments.multipath)
    names = ("found", "certain", "wrong", "few", "wrong")
    print(f"{'n':>3} {'direct':>6} {'heading':>11}", *(f"{name:>7}" for name in names), f"{'ms':>6}")
    for count in arguments.measurements:
        for direct in (1.0, 0.75):
            for knowledge in ("heading", "reciprocal", "one-way"):
                radio = Radio(measurements=count, direct=direct)
                r = run(knowledge, radio, arguments.trials, arguments.seed, settings)
                print(
                    f"{count:>3} {direct:>6} {knowledge:>11} {r['found']:>7.1%} {r['certain']:>7.1%} {r['wrong']:>7.1%}"
                    f" {r['few']:>7.1%} {r['few_wrong']:>7.1%} {r['milliseconds']:>6.1f}"
                )


if __name__ == "__main__":
    main()
