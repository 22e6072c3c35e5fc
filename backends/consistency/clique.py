"""Pairwise consistency maximisation as published: the largest set of closures in which every pair agrees.

Mangelson et al., "Pairwise consistent measurement set maximization", ICRA 2018.  Two closures `z_ik`, `z_jl` of one
pair of robots and the odometry between their ends make a cycle; for true closures it differs from identity by noise.
Kept for baselines: DiSCo-SLAM decides so, with its own metric and cycle.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.closure_sets import ClosureSet, Decision
from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency.cycles import Cycles
from wiclosure.backends.consistency.pair_report import PairConsistency
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.max_clique import max_clique
from wiclosure.types import BoolArray, FloatArray, IntArray, Trajectory


@cache
def chi_square_limit(probability: float, degrees: int = 6) -> float:
    """Quantile of chi-square with the degrees of freedom of a rigid transform, 3 in the plane."""
    return float(chi2.ppf(probability, degrees))


def largest_clique(
    closure_set: ClosureSet, trajectories: Mapping[str, Trajectory], settings: PcmSettings
) -> tuple[PairConsistency, dict[int, Decision]]:
    """Accepts the maximum clique of one pair of robots, and closures within one robot that agree with its odometry."""
    alive = np.flatnonzero(
        np.ones(len(closure_set), bool)
        if closure_set.between_robots
        else _within_odometry(closure_set, trajectories, settings)
    )
    checked = closure_set.subset(alive)
    consistent = consistency_matrix(checked, trajectories, settings)
    best = max_clique(consistent, time_budget_s=settings.time_budget_s)
    refused = _refused(checked, len(best), settings)
    members = np.zeros(len(checked), bool)
    members[list(best.members)] = not refused
    sentence = f"{closure_set.name}: " + (refused or f"{len(best)} of {len(checked)} closures agree and are accepted")
    if not best.proven:
        sentence += f" (the search for a larger set was stopped after {settings.time_budget_s:g} s)"
    kept = int(members.sum())
    report = PairConsistency(
        closure_set.robot_a,
        closure_set.robot_b,
        len(checked),
        kept,
        len(best),
        0,
        best.proven,
        ambiguous=False,
        sentence=sentence,
    )
    decisions = dict.fromkeys(closure_set.rows.tolist(), Decision(False, "contradicts the robot's own odometry"))
    for row, member, agrees in zip(checked.rows.tolist(), members, consistent[:, members].sum(axis=1), strict=True):
        outside = f"inconsistent with the {kept} closures of the largest consistent set (agrees with {agrees})"
        inside = f"one of {kept} closures that agree"
        decisions[row] = Decision(True, inside) if member else Decision(False, refused or outside)
    return report, decisions


def consistency_matrix(
    closure_set: ClosureSet, trajectories: Mapping[str, Trajectory], settings: PcmSettings
) -> BoolArray:
    """Which closures `(N, N)` agree, diagonal false."""
    cycles, consistent = Cycles.of(closure_set, trajectories), np.zeros((len(closure_set), len(closure_set)), bool)
    for row in range(1, len(closure_set)):
        consistent[row, :row] = consistent[:row, row] = _agrees(cycles, row, np.arange(row), settings)
    return consistent


def _agrees(cycles: Cycles, row: int, others: IntArray, settings: PcmSettings) -> BoolArray:
    if settings.metric == "mahalanobis":
        limit = chi_square_limit(settings.probability)
        return cycles.mahalanobis_squared(row, others, limit=limit) < limit
    legacy = settings.cycle == "legacy"
    T = cycles.legacy_transforms(row, others) if legacy else cycles.closing_transforms(row, others)
    return _short(se3.log(T), settings)


def _within_odometry(
    closure_set: ClosureSet, trajectories: Mapping[str, Trajectory], settings: PcmSettings
) -> BoolArray:
    """Closures `(N,)` within one robot that are within its odometry's drift."""
    odometry = trajectories[closure_set.robot_a]
    x = odometry.relative_pose(closure_set.index_a, closure_set.index_b)
    error = se3.log(se3.between(closure_set.T_a_b, x))
    if settings.metric == "unit":
        return _short(error, settings)
    sigma = se3.inverse_covariance(closure_set.T_a_b, closure_set.covariance)
    sigma = se3.compose_covariance(sigma, x, odometry.relative_covariance(closure_set.index_a, closure_set.index_b))
    return np.asarray(mahalanobis_squared(error, sigma) < chi_square_limit(settings.probability))


def _short(error: FloatArray, settings: PcmSettings) -> BoolArray:
    return np.asarray(np.linalg.norm(error, axis=1) < settings.unit_threshold)


def _refused(closure_set: ClosureSet, size: int, settings: PcmSettings) -> str:
    """Why a largest set is not accepted; empty if it is."""
    total, needed = len(closure_set), settings.min_clique_size if closure_set.between_robots else 1
    if size < needed:
        if total <= 1:
            return "a single closure cannot be checked" if total else "no closure left to check"
        found = "no two" if size == 1 else f"no more than {size}"
        return f"{found} of the {total} closures agree, {needed} must"
    if total < settings.start_threshold:
        return f"{total} closures are fewer than the {settings.start_threshold} that pcm.start_threshold asks for"
    return ""
