"""Do stated covariances hold the truth?  Range-only, collinear and short meetings, with constant errors of usual size.

    python benchmarks/coverage.py [--trials 100] [--seed 1] [--meetings site]

Worlds and radio are those of `systematic_worlds.py`; biases, scales and clocks are drawn from the priors of the
calibration, odometry drifts as its model says.  A row tells, for alignments that are called certain, how often the
stated 90 % region holds the truth: of yaw and place at the middle of the meeting (`alignment`), and of the horizontal
displacement of kept pairs that were near each other in time (`prediction`), which is what the gate and the registration
use.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import stats
from systematic_faults import Case
from systematic_worlds import WORLDS, Hearing, drifted, listen, wrap

from wiclosure import se3
from wiclosure.types import FilterResult, FloatArray, WirelessLog
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.filter import WiClosureFilter

PROBABILITY = 0.9
SHORT_S = 12.0
PRIORS = CalibrationPriors()


def ranges_only(log: WirelessLog) -> WirelessLog:
    """Without directions."""
    return replace(log, measurements=tuple(replace(m, paths=()) for m in log.measurements))


def short(log: WirelessLog) -> WirelessLog:
    """The middle seconds only."""
    middle_ns = (log.measurements[0].stamp_ns + log.measurements[-1].stamp_ns) // 2
    near = (m for m in log.measurements if abs(m.stamp_ns - middle_ns) < SHORT_S / 2 * 1e9)
    return replace(log, measurements=tuple(near))


def unchanged(log: WirelessLog) -> WirelessLog:
    """All of it."""
    return log


@dataclass(frozen=True)
class Meeting:
    """How two robots meet: a world, what is left of its log, and poses between measurements."""

    name: str
    world: str
    log: Callable[[WirelessLog], WirelessLog]
    every: int


MEETINGS = (
    Meeting("range-only, roaming", "roaming", ranges_only, 2),
    Meeting("range-only, site", "site", ranges_only, 4),
    Meeting("range-only, street", "street", ranges_only, 1),
    Meeting("collinear", "aisle", unchanged, 4),
    Meeting("short, roaming", "roaming", short, 2),
    Meeting("short, site", "site", short, 2),
    Meeting("long, site", "site", unchanged, 8),
)


@dataclass
class Coverage:
    """Of all trials of one kind of meeting."""

    certain: int = 0
    aligned: int = 0
    predicted: list[float] = field(default_factory=list)


def make(meeting: Meeting, rng: np.random.Generator) -> Case:
    """A case with constant errors."""
    world = replace(WORLDS[meeting.world](2, rng), every=meeting.every)
    odometry = {name: drifted(t, rng) for name, t in world.truth.items()}
    for name, one in odometry.items():
        poses = one.poses.copy()
        poses[:, :3, 3] = poses[0, :3, 3] + (1 + rng.normal(0, PRIORS.scale)) * (poses[:, :3, 3] - poses[0, :3, 3])
        odometry[name] = replace(one, poses=poses)
    bias, scale = rng.normal(0, PRIORS.range_bias_m), 1 + rng.normal(0, PRIORS.range_scale)
    turned, late_ns = rng.normal(0, PRIORS.mounting_rad), round(rng.normal(0, PRIORS.clock_s) * 1e9)
    heard = listen(world, Hearing(), rng)
    log = WirelessLog(
        tuple(
            replace(
                m,
                range_m=abs((m.range_m or 0.0) * scale + bias),
                paths=tuple(replace(p, azimuth=wrap(p.azimuth + turned)) for p in m.paths),
            )
            for m in heard.measurements
        )
    )
    odometry["b"] = replace(odometry["b"], stamps_ns=odometry["b"].stamps_ns + late_ns)
    return Case(world.truth, odometry, meeting.log(log))


def count(case: Case, result: FilterResult, covered: Coverage) -> None:
    """Adds a trial's outcome."""
    (alignment,) = result.alignments or (None,)
    if alignment is None or alignment.ambiguous or alignment.best is None or alignment.covariance is None:
        return
    covered.certain += 1
    off, spread = _off(case, alignment.best.T_a_b, alignment.covariance)
    covered.aligned += bool(off @ np.linalg.solve(spread, off) < stats.chi2.ppf(PROBABILITY, 3))
    (pairs,) = result.pairs
    met = np.flatnonzero(np.abs(pairs.index_a - pairs.index_b) < 10)
    rows = met[np.linspace(0, len(met) - 1, min(len(met), 50)).astype(int)] if len(met) else met
    predicted = pairs.predicted(rows)
    if predicted is None or len(rows) == 0:
        return
    T, C = predicted
    true = se3.between(case.truth["a"].poses[pairs.index_a[rows]], case.truth["b"].poses[pairs.index_b[rows]])
    error = np.einsum("mji,mj->mi", T[:, :3, :3], true[:, :3, 3] - T[:, :3, 3])[:, :2]
    chi2 = np.einsum("mi,mi->m", error, np.linalg.solve(C[:, 3:5, 3:5], error[..., None])[..., 0])
    covered.predicted.append(float(np.mean(chi2 < stats.chi2.ppf(PROBABILITY, 2))))


def _off(case: Case, T_a_b: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Error of yaw and horizontal place `(3,)` at the middle of the meeting, and its covariance."""
    stamps = [m.stamp_ns for m in case.log.measurements]
    row = int(np.argmin(np.abs(case.truth["a"].stamps_ns - stamps[len(stamps) // 2])))
    a, b = case.odometry["a"].poses[row], case.odometry["b"].poses[row]
    true = a @ se3.between(case.truth["a"].poses[row], case.truth["b"].poses[row])
    said = T_a_b @ b
    by_error = np.zeros((3, 6))
    by_error[0, 2] = 1.0
    by_error[1:, :3], by_error[1:, 3:] = (-T_a_b[:3, :3] @ se3.skew(b[:3, 3]))[:2], T_a_b[:2, :3]
    yaw = float(se3.wrap_angle(se3.yaw(said) - se3.yaw(true)))
    return np.array([yaw, *(said[:2, 3] - true[:2, 3])]), by_error @ covariance @ by_error.T


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--meetings", default="", help="only those whose name holds this")
    arguments = parser.parse_args()
    print(f"{'meeting':22} {'certain':>8} {'alignment':>10} {'prediction':>11}  of {arguments.trials}")
    for number, meeting in enumerate(MEETINGS):
        if arguments.meetings not in meeting.name:
            continue
        covered = Coverage()
        for trial in range(arguments.trials):
            case = make(meeting, np.random.default_rng([arguments.seed, number, trial]))
            if len(case.log.measurements) > 1:
                count(case, WiClosureFilter().candidates(case.odometry, case.log), covered)
        aligned = covered.aligned / max(covered.certain, 1)
        predicted = np.mean(covered.predicted) if covered.predicted else float("nan")
        print(f"{meeting.name:22} {covered.certain:8d} {aligned:10.0%} {predicted:11.0%}", flush=True)


if __name__ == "__main__":
    main()
