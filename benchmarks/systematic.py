"""The filter under systematic errors: how often it calls an alignment certain that is wrong.

    python benchmarks/systematic.py [--trials 30] [--faults clocks,mirror] [--worlds aisle,site] [--seed 1]
        [--first-trial 10] [--record outcomes.jsonl]

One fault at a time (`systematic_faults.py`), in worlds of their own (`systematic_worlds.py`).  Counted as *certain and
wrong*: the filter calls the alignment certain, it is off by more than 4 m or 25 degrees at the middle of the meeting,
and it either lies beyond its own 3 sigma or loses more than 5 % of the pairs within 35 m.  *Pruned*: not certain, but
the pairs of a few alignments that are possible are kept, and *lost* counts those that lose more than 5 % of the near
pairs.  *Tellable*: logs in which the paths tell the fault at all (`systematic_telling.py`); *told*: of these, those in
which a sentence of the diagnosis says what the fault seems to be; *named*: the same of all logs; *listed*: of all logs,
those in which one says at least that it would fit as well.

Each trial is drawn on its own, by seed, world and number.  With `--record`, outcomes of trials are written to a file as
they come, and those that are in it are counted without being run: of one version of the filter.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from systematic_faults import FAULTS, Case, Fault
from systematic_telling import tellable
from systematic_unseen import UNSEEN
from systematic_worlds import WORLDS, World, drifted, listen, wrap
from trial_records import TrialRecords

from wiclosure import se3
from wiclosure.types import CandidatePairs, FilterResult, FloatArray, FrameAlignment, PredictionKind
from wiclosure.wiclosure_filter.filter import WiClosureFilter

NEAR_M, WRONG_M, WRONG_RAD = 35.0, 4.0, np.radians(25.0)


@dataclass
class Score:
    """Of all trials of one fault: numbers of pairs of robots, and of trials that tell the fault or name it."""

    trials: int = 0
    pairs: int = 0
    certain: int = 0
    wrong: int = 0
    pruned: int = 0
    lost: int = 0
    tellable: int = 0
    told: int = 0
    named: int = 0
    listed: int = 0
    crashed: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def add(self, other: Score) -> None:
        """Counts other trials as well."""
        for one in fields(self):
            setattr(self, one.name, getattr(self, one.name) + getattr(other, one.name))

    def row(self, fault: Fault) -> str:
        """As the table shows it."""
        told = f"{'-':>9} {'-':>5} {'-':>6} {'-':>6}"
        if fault.words:
            told = f"{self.tellable:9d} {self.told:5d} {self.named:6d} {self.listed:6d}"
        return (
            f"{fault.name:28} {self.certain:8d} {self.wrong:6d} {fault.goal:5d} {self.pruned:7d} {self.lost:5d} {told}"
            f" {1000 * self.seconds / max(self.trials, 1):6.0f}  {self.pairs}"
        )


def make(world: World, fault: Fault, rng: np.random.Generator) -> Case:
    """One trial."""
    odometry = world.odometry or {name: drifted(t, rng) for name, t in world.truth.items()}
    case = Case(world.truth, odometry, listen(world, fault.hearing, rng))
    return fault.spoil(case, rng) if case.log.measurements else case  # robots that never hear each other


def count_outcome(case: Case, result: FilterResult, fault: Fault, score: Score, *, tells: bool = False) -> None:
    """Adds a trial's outcome; `tells` whether the fault can be told."""
    score.trials += 1
    score.seconds += result.seconds
    said = [sentence.split("would fit as well")[0] for sentence in result.diagnosis]
    score.tellable += tells
    named = any(word in sentence for word in fault.words for sentence in said)
    score.told += tells and named
    score.named += named
    score.listed += any(word in sentence for word in fault.words for sentence in result.diagnosis)
    for alignment in result.alignments:
        score.pairs += 1
        (kept,) = [
            kept for kept in result.pairs if (kept.robot_a, kept.robot_b) == (alignment.robot_a, alignment.robot_b)
        ]
        lost = _lost(case, kept) > 0.05
        score.lost += lost
        if alignment.ambiguous or alignment.best is None or alignment.covariance is None:
            score.pruned += kept.predicts is PredictionKind.POSE
            continue
        score.certain += 1
        off_m, off_rad, chi2 = _off(case, alignment, alignment.best.T_a_b, alignment.covariance)
        off = off_m > WRONG_M or off_rad > WRONG_RAD
        score.wrong += bool(off and (chi2 > 9.0 or lost))


def _lost(case: Case, kept: CandidatePairs) -> float:
    """Share of near pairs of keyframes that were not kept."""
    a, b = case.truth[kept.robot_a].positions, case.truth[kept.robot_b].positions
    near = np.linalg.norm(a[:, None] - b[None], axis=2) <= NEAR_M
    return 1.0 - float(near[kept.index_a, kept.index_b].sum()) / max(float(near.sum()), 1.0)


def _off(
    case: Case, alignment: FrameAlignment, T_a_b: FloatArray, covariance: FloatArray
) -> tuple[float, float, float]:
    """Error at the middle of the meeting: m, rad, and the larger chi-square of the two, each a number in the plane."""
    a, b = alignment.robot_a, alignment.robot_b
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


def run(world: str, fault: Fault, seed: int, trial: int) -> dict[str, Any]:
    """The score of one trial of a fault in a world, drawn by its seed and number."""
    score = Score()
    rng = np.random.default_rng([seed, list(WORLDS).index(world), trial])
    where = WORLDS[world](fault.robots, rng)
    case = make(where, fault, rng)
    tells = bool(fault.words) and tellable(where, fault, rng)
    try:
        result = WiClosureFilter().candidates(case.odometry, case.log)
        count_outcome(case, result, fault, score, tells=tells)
    except (ArithmeticError, LookupError, RuntimeError, ValueError) as error:
        score.crashed.append(f"{world} {trial}: {error!r}")
    return asdict(score)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=30, help="in each world")
    parser.add_argument("--first-trial", type=int, default=0, help="number of the first one")
    parser.add_argument("--faults", default="", help="only those whose name holds one of these words, comma separated")
    parser.add_argument("--unseen", action="store_true", help="faults that no correction knows, instead")
    parser.add_argument("--worlds", default=",".join(WORLDS))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--record", type=Path, help="file of outcomes to go on from, one line a trial")
    arguments = parser.parse_args()
    words = [word for word in arguments.faults.split(",") if word]
    columns = "fault:28 certain:8 wrong:6 goal:5 pruned:7 lost:5 tellable:9 told:5 named:6 listed:6 ms:6"
    heads = (column.split(":") for column in columns.split())
    print(" ".join(f"{name:{'' if name == 'fault' else '>'}{width}}" for name, width in heads), " of pairs")
    records, seed = TrialRecords(arguments.record), arguments.seed
    for fault in UNSEEN if arguments.unseen else FAULTS:
        if words and not any(word in fault.name for word in words):
            continue
        score = Score()
        for world in arguments.worlds.split(","):
            for trial in range(arguments.first_trial, arguments.first_trial + arguments.trials):
                key = f"{fault.name}, {world}, seed {seed}, trial {trial}"
                score.add(Score(**records.outcome(key, partial(run, world, fault, seed, trial))))
        print(score.row(fault), flush=True)
        for crash in score.crashed:
            print("   crashed:", crash)


if __name__ == "__main__":
    main()
