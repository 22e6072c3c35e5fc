"""Verdicts on sets of closures that are known to be true, or of look-alike places, under a log with one fault.

    python benchmarks/mutual_verdicts.py [--scenario city] [--seeds 2] [--faults reversed,feet]

Paths and radio are those of a scenario, odometry drifts as its model says, no scan is registered: closures are made of
the truth.  *True*: 12 closures between places within 6 m.  *Look-alike*: 25 that agree with each other but put the
second robot one block (95 m, 75 m) away, among 5 that agree with none.  The radio is asked as where it predicts
nothing.  A row counts verdicts over seeds and sets; `wrong` are true sets that were refused, or false ones that were
accepted.
"""

from __future__ import annotations

import argparse
from collections import Counter

import numpy as np
from mutual_faults import FAULTS

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.pipeline.config import MutualCheckSettings
from wiclosure.pipeline.mutual_check.odds import Verdict, agrees_with_radio
from wiclosure.pipeline.mutual_check.radio_evidence import PairRadio
from wiclosure.pipeline.mutual_check.set_evidence import SetEvidence
from wiclosure.simulation.scenarios.registry import ScenarioSettings, make_scenario
from wiclosure.types import Closure, FloatArray, KeyframeId, Trajectory, WirelessLog
from wiclosure.wiclosure_filter.config import AlignmentSettings

SIGMA = np.repeat([0.005, 0.05], 3)
SHIFTS = {"true": [], "look-alike": [(95.0, 0.0, 0.0), (-95.0, 0.0, 0.0), (0.0, 75.0, 0.0), (0.0, -75.0, 0.0)]}


def drifted(truth: Trajectory, rng: np.random.Generator) -> Trajectory:
    """Odometry in a frame of its own."""
    drift, steps = DriftModel(), se3.between(truth.poses[:-1], truth.poses[1:])
    metres = np.linalg.norm(steps[:, :3, 3], axis=1)
    sigma = np.zeros((len(steps), 6))
    sigma[:, 2] = drift.rotation_walk * np.sqrt(metres)
    sigma[:, 3:5] = (drift.translation_walk * np.sqrt(metres))[:, None]
    poses = [np.eye(4)]
    for step in steps @ se3.exp(sigma * rng.normal(size=sigma.shape)):
        poses.append(poses[-1] @ step)
    return Trajectory(truth.robot, truth.stamps_ns, np.array(poses))


def each_metre(path: Trajectory) -> Trajectory:
    """Keyframes a metre apart."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path.positions, axis=0), axis=1))])
    return path.subset(np.unique(np.searchsorted(way, np.arange(0.0, way[-1]))))


def closures(truth: dict[str, Trajectory], shift: FloatArray, count: int, rng: np.random.Generator) -> list[Closure]:
    """Between places that are within 6 m once b is shifted."""
    (a, T_a), (b, T_b) = ((robot, t.poses.copy()) for robot, t in truth.items())
    T_b[:, :3, 3] += shift
    near = np.argwhere(np.linalg.norm(T_a[:, None, :3, 3] - T_b[None, :, :3, 3], axis=2) < 6.0)
    chosen = rng.permutation(near)[:count].tolist()
    noise = se3.exp(rng.normal(size=(len(chosen), 6)) * SIGMA)
    return [
        Closure.from_measurement(
            KeyframeId(a, i), KeyframeId(b, j), se3.between(T_a[i], T_b[j]) @ off, np.diag(SIGMA**2)
        )
        for (i, j), off in zip(chosen, noise, strict=True)
    ]


def verdict(radio: PairRadio, found: list[Closure], others: int) -> tuple[str, bool]:
    """Verdict on a set, and whether the radio is named."""
    evidence = SetEvidence.of(found, others, radio)
    agrees = agrees_with_radio(evidence.claimed)
    weighed = evidence.weighed(evidence.errors(search=not agrees), MutualCheckSettings())
    if agrees and weighed.verdict is not Verdict.CLOSURES:
        return "agree", False
    return str(weighed.verdict), weighed.verdict in {Verdict.CLOSURES, Verdict.NEITHER, Verdict.UNDECIDED}


def main() -> None:
    """Prints the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenario", default="city")
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--first-seed", type=int, default=11)
    parser.add_argument("--faults", default="")
    arguments = parser.parse_args()
    words = [word for word in arguments.faults.split(",") if word]
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.seeds)
    worlds = [world(arguments.scenario, seed) for seed in seeds]
    for fault, spoil in FAULTS.items():
        if words and not any(word in fault for word in words):
            continue
        for kind, shifts in SHIFTS.items():
            counts: Counter[str] = Counter()
            named = wrong = 0
            for seed, (truth, odometry, log) in zip(seeds, worlds, strict=True):
                spoilt = spoil(log)
                if fault != "honest" and spoilt == log:
                    continue
                radio = PairRadio.of(tuple(truth), odometry, spoilt, AlignmentSettings())  # type: ignore[arg-type]
                rng = np.random.default_rng(seed)
                for shift in shifts or [(0.0, 0.0, 0.0)]:
                    found = closures(truth, np.array(shift), 25 if shifts else 12, rng)
                    if len(found) < 5:
                        continue
                    said, is_named = verdict(radio, found, 5 if shifts else 1)
                    counts[said] += 1
                    named += is_named
                    accepted = said in {"agree", "closures", "compatible"}
                    wrong += accepted if shifts else not accepted
            total = sum(counts.values())
            print(f"{fault:22} {kind:10} {total:3d} sets, {wrong} wrong, {named} named: {dict(counts)}", flush=True)


def world(name: str, seed: int) -> tuple[dict[str, Trajectory], dict[str, Trajectory], WirelessLog]:
    """Truth and odometry of the first two robots, and the log."""
    scenario, rng = make_scenario(name, ScenarioSettings(seed=seed)), np.random.default_rng(seed)
    truth = {robot: each_metre(scenario.ground_truth(robot)) for robot in list(scenario.robots)[:2]}
    return truth, {robot: drifted(path, rng) for robot, path in truth.items()}, scenario.wireless()


if __name__ == "__main__":
    main()
