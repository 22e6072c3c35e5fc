"""The filter on real odometry with simulated radio, and on long synthetic roads.

    python benchmarks/filter.py [--seeds 10] [--sequences 08,00,05] [--spacing 2,1] [--drift 6]
        [--drift-weight 2] [--paper] [--skip-long]

KITTI: three contiguous thirds as three robots that start together; real KISS-ICP odometry; one-way measurements every
10 m within 150 m, UWB 0.5 m, AOA 10 degrees, four false paths, direct path absent in 15 %, no heading.  A pair is true
within 35 m in ground truth; recall and precision are over all pairs of robots that links join, directly or through a
third.  Times are wall times of `WiClosureFilter.candidates`, everything included.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from kitti import Team, thirds
from radio import Radio

from wiclosure import se3
from wiclosure.memory import peak_rss_mb
from wiclosure.pipeline.config import load_config
from wiclosure.types import CandidatePairs, FilterResult, FloatArray, Trajectory
from wiclosure.wiclosure_filter.config import FilterSettings, SharedTrajectorySettings
from wiclosure.wiclosure_filter.filter import WiClosureFilter
from wiclosure.wiclosure_filter.search.gates import make_gate
from wiclosure.wiclosure_filter.search.overlap_search import find_overlap
from wiclosure.wiclosure_filter.search.pair_model import PairModel

TRUE_M = 35.0


@dataclass(frozen=True)
class Score:
    """Of one run."""

    recall: float
    precision: float
    kept: int
    total: int
    ambiguous: int
    seconds: float
    coverage: float
    nees: float


def score(result: FilterResult, team: Team) -> Score:
    """Compares kept pairs and predicted displacements with ground truth."""
    true = kept = both = 0
    inside, squared = [], []
    for pairs in result.pairs:
        if pairs.predicts is None:
            continue  # nothing joins these robots
        a, b = team.truth[pairs.robot_a], team.truth[pairs.robot_b]
        near = np.linalg.norm(a.positions[:, None] - b.positions[None], axis=2) <= TRUE_M
        true, kept = true + int(near.sum()), kept + len(pairs)
        both += int(near[pairs.index_a, pairs.index_b].sum())
        if len(pairs) == 0:
            continue
        error, covariance = horizontal_errors(pairs, a, b)
        inside.append(np.abs(error) < 1.645 * np.sqrt(np.einsum("mii->mi", covariance)))
        squared.append(np.einsum("mi,mij,mj->m", error, np.linalg.inv(covariance), error) / 2)
    return Score(
        recall=both / max(true, 1),
        precision=both / max(kept, 1),
        kept=result.pairs_kept,
        total=result.pairs_total,
        ambiguous=sum(a.ambiguous for a in result.alignments),
        seconds=result.seconds,
        coverage=float(np.mean(np.concatenate(inside))) if inside else np.nan,
        nees=float(np.mean(np.concatenate(squared))) if squared else np.nan,
    )


def horizontal_errors(pairs: CandidatePairs, a: Trajectory, b: Trajectory) -> tuple[FloatArray, FloatArray]:
    """Errors `(M, 2)` of predicted displacements at evenly chosen kept pairs, in b's axes, and their covariances."""
    rows = np.unique(np.linspace(0, len(pairs) - 1, 2000).astype(np.int64))
    predicted = pairs.predicted(rows)
    assert predicted is not None
    T, C = predicted
    true = se3.between(a.poses[pairs.index_a[rows]], b.poses[pairs.index_b[rows]])
    error = np.einsum("mji,mj->mi", T[:, :3, :3], true[:, :3, 3] - T[:, :3, 3])
    return error[:, :2], C[:, 3:5, 3:5]


def on_kitti(sequence: str, spacing_m: float, seeds: int, drift: float, settings: FilterSettings) -> list[Score]:
    scores = []
    for seed in range(seeds):
        whole = thirds(sequence).worse(drift, seed) if drift > 1 else thirds(sequence)
        team = whole.keyframes(spacing_m)
        wireless = Radio().listen(whole.truth, seed)
        scores.append(score(WiClosureFilter(settings).candidates(team.odometry, wireless), team))
    print(f"KITTI {sequence}, keyframes {spacing_m:g} m, {scores[0].total} pairs, {seeds} seeds")
    for name, worst in (
        ("recall", min),
        ("precision", min),
        ("seconds", max),
        ("kept", max),
        ("ambiguous", max),
        ("coverage", min),
        ("nees", max),
    ):
        values = [getattr(s, name) for s in scores]
        print(f"  {name:10s} median {np.median(values):10.4f}   worst {worst(values):10.4f}")
    return scores


def against_brute_force() -> None:
    """The same gate on every pair, in the same run."""
    whole = thirds("08")
    team = whole.keyframes(2.0)
    wireless = Radio().listen(whole.truth, 0)
    chosen = WiClosureFilter()
    links = chosen.gather(team.odometry, wireless).by_pair
    shared = chosen.share(team.odometry, links, list(chosen.align(team.odometry, links).values()))
    gate = make_gate(chosen.settings.gate)
    for (a, b), estimate in shared.estimates.items():
        (model,) = estimate.models(a, b)
        start = perf_counter()
        found = find_overlap(model, gate)
        search = perf_counter() - start
        start = perf_counter()
        p, k = (grid.ravel() for grid in np.indices((len(model.a), len(model.b))))
        keep = gate.score(model.displacement(p, k), model.covariance(p, k)).keep
        brute = perf_counter() - start
        same = np.array_equal(found.index_a, p[keep]) and np.array_equal(found.index_b, k[keep])
        print(f"08 {a}-{b}: search {search:.3f} s, every pair {brute:.3f} s, same pairs: {same}")


def long_roads(size: int, seed: int = 0) -> tuple[Team, float]:
    """Two robots of `size` keyframes, 1 m apart, that wander and share one per cent of their road."""
    rng = np.random.default_rng(seed)
    shared = size // 100
    parts = []
    for side in (1.0, -1.0):
        # Before and after the shared road each robot keeps to its own side of it.
        # Beta drives 40 m behind alpha: antennas at one place have no direction.
        along = np.arange(size) - size / 2.0 + 20.0 * side
        away = np.maximum(np.abs(along) - shared / 2.0, 0.0)
        wiggle = 20.0 * np.sin(np.cumsum(rng.normal(0, 0.01, size))) * np.minimum(away / 50.0, 1.0)
        x, y = along * 0.7, side * 0.7 * away + wiggle
        yaw = np.arctan2(np.gradient(y), np.gradient(x))
        parts.append(se3.from_yaw(yaw, np.stack([x, y, 0 * x], axis=1)))
    stamps_ns = np.arange(size, dtype=np.int64) * 500_000_000
    truth = {name: Trajectory(name, stamps_ns, poses) for name, poses in zip(("alpha", "beta"), parts, strict=True)}
    odometry = {name: t.moved(se3.inverse(t.poses[0])) for name, t in truth.items()}
    return Team(truth, odometry), shared


def on_long_roads(settings: FilterSettings) -> None:
    print("two robots that share 1 % of their road, both there at the same time, a measurement every 10 m within 150 m")
    for size in (10_000, 30_000, 100_000):
        team, _ = long_roads(size)
        wireless = Radio().listen(team.truth, 0)
        chosen = WiClosureFilter(settings)
        start = perf_counter()
        links = chosen.gather(team.odometry, wireless).by_pair
        alignments = list(chosen.align(team.odometry, links).values())
        aligned = perf_counter()
        shared = chosen.share(team.odometry, links, alignments)
        models: tuple[PairModel, ...] = ()
        if ("alpha", "beta") in shared.estimates:
            models = shared.estimates["alpha", "beta"].models("alpha", "beta")
        joined = perf_counter()
        kept = sum(len(find_overlap(model, make_gate(settings.gate)).index_a) for model in models)
        searched = perf_counter()
        print(f"  {size:7d} keyframes each, {len(wireless.measurements)} measurements:", end=" ")
        print(f"alignment {aligned - start:.2f} s, shared trajectory {joined - aligned:.2f} s,", end=" ")
        print(f"search and gate {searched - joined:.2f} s, {kept} pairs kept, peak {peak_rss_mb():.0f} MB;", end=" ")
        print("; ".join(alignment.reason for alignment in alignments))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--sequences", default="08,00,05")
    parser.add_argument("--spacing", default="2,1")
    parser.add_argument("--drift", type=float, default=1.0, help="odometry made to drift so many times its model")
    parser.add_argument("--drift-weight", type=float, default=2.0, help="see the filter's settings; 1e9: not scaled")
    parser.add_argument("--paper", action="store_true", help="the paper's method: PCM, shortest routes, Mahalanobis")
    parser.add_argument("--skip-long", action="store_true")
    arguments = parser.parse_args()
    shared = SharedTrajectorySettings(drift_weight=arguments.drift_weight)
    settings = load_config("paper").filter if arguments.paper else FilterSettings(shared_trajectory=shared)
    if not arguments.skip_long:
        on_long_roads(settings)
        against_brute_force()
    for spacing in map(float, arguments.spacing.split(",")):
        scores = []
        for sequence in arguments.sequences.split(","):
            scores += on_kitti(sequence, spacing, arguments.seeds, arguments.drift, settings)
        coverage, nees = (np.mean([getattr(s, name) for s in scores]) for name in ("coverage", "nees"))
        missed = 1.0 - np.mean([s.recall for s in scores])
        print(f"all, keyframes {spacing:g} m: coverage {coverage:.3f}, NEES {nees:.2f}, true pairs missed {missed:.2%}")


if __name__ == "__main__":
    main()
