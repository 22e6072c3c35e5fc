"""Pairwise consistency maximisation: the largest set of closures that agree with each other and with odometry.

Mangelson et al., "Pairwise consistent measurement set maximization", ICRA 2018.  Two closures `z_ik`, `z_jl` of one
pair of robots and the odometry between their ends make a cycle; for true closures it differs from identity by noise.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import comb

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.closure_sets import ClosureSet, closure_sets, decided
from wiclosure.backends.config import PcmSettings
from wiclosure.backends.cycles import Cycles, mahalanobis_squared
from wiclosure.max_clique import Clique, max_clique
from wiclosure.types import Closure, Decision, FloatArray, IntArray, Trajectory

BoolArray = NDArray[np.bool_]
BELIEVABLE_CHANCE = 0.05  # expected number of sets as large that chance alone would make


@dataclass(frozen=True, slots=True)
class PairConsistency:
    """What PCM found between two robots.

    Args:
        robot_a, robot_b: the robots; the same name twice for closures within one robot.
        considered: closures that were checked.
        kept: size of the set believed; 0 if none is.
        largest: size of the largest consistent set.
        rival: size of the largest set among the closures that mostly contradict it.
        proven: false if the time ran out before a larger set was excluded.
        sentence: the same for the user.
    """

    robot_a: str
    robot_b: str
    considered: int
    kept: int
    largest: int
    rival: int
    proven: bool
    sentence: str


@dataclass(frozen=True, slots=True, eq=False)
class PcmResult:
    """Closures with PCM's decision, in the order given, and what was found between each two robots."""

    closures: tuple[Closure, ...]
    pairs: tuple[PairConsistency, ...]

    @property
    def diagnosis(self) -> tuple[str, ...]:
        """One sentence for each pair of robots."""
        return tuple(pair.sentence for pair in self.pairs)


def pairwise_consistent(
    closures: Sequence[Closure], trajectories: Mapping[str, Trajectory], settings: PcmSettings
) -> PcmResult:
    """Accepts, for each pair of robots, the largest set of verified closures that agree; rejects the others.

    Args:
        closures: any; those neither verified nor accepted pass through unchanged.
        trajectories: keyframe odometry by robot, with its drift model; each robot in its own frame.
        settings: see `PcmSettings`.

    Raises:
        InputError: a closure names a robot or a keyframe that the trajectories do not have.
    """
    if not settings.enabled:
        return PcmResult(tuple(closures), ())
    sets, unusable = closure_sets(closures, trajectories, settings.noise)
    decisions = {row: (Decision.REJECTED, reason) for row, reason in unusable.items()}
    degrees: dict[int, int] = {}
    reports: list[PairConsistency] = []
    for found in sets:
        stray = (
            np.zeros(len(found), bool) if found.between_robots else ~agrees_with_odometry(found, trajectories, settings)
        )
        decisions |= {
            int(row): (Decision.REJECTED, "contradicts the robot's own odometry") for row in found.rows[stray]
        }
        checked = found.subset(np.flatnonzero(~stray))
        consistent = consistency_matrix(checked, trajectories, settings)
        degrees |= dict(zip(checked.rows.tolist(), consistent.sum(axis=1).tolist(), strict=True))
        alone = not any(np.isfinite(closures[row].evidence.prior_chi2) for row in checked.rows)
        places = _places(checked, trajectories) if alone else None
        report, verdicts = _judge(checked, consistent, places, settings)
        decisions |= verdicts
        reports.append(report)
    result = decided(closures, decisions)
    for row, degree in degrees.items():
        result[row] = replace(result[row], evidence=replace(result[row].evidence, consistent_with=degree))
    return PcmResult(tuple(result), tuple(reports))


def consistency_matrix(
    closures: ClosureSet, trajectories: Mapping[str, Trajectory], settings: PcmSettings
) -> BoolArray:
    """`(N, N)` symmetric, diagonal false: which closures of two robots agree with each other."""
    cycles = Cycles.of(closures, trajectories)
    consistent = np.zeros((len(closures), len(closures)), bool)
    for row in range(1, len(closures)):
        consistent[row, :row] = consistent[:row, row] = agree(cycles, row, np.arange(row), settings)
    return consistent


def agree(cycles: Cycles, row: int, others: IntArray, settings: PcmSettings) -> BoolArray:
    """Which of the closures `others (M,)` agree with the closure `row`."""
    if settings.metric == "mahalanobis":
        limit = chi_square_limit(settings.probability)
        return np.asarray(cycles.mahalanobis_squared(row, others, limit=limit) < limit)
    legacy = settings.cycle == "legacy"
    T = cycles.legacy_transforms(row, others) if legacy else cycles.closing_transforms(row, others)
    return np.asarray(np.linalg.norm(se3.log(T), axis=1) < settings.unit_threshold)


def agrees_with_odometry(z: ClosureSet, trajectories: Mapping[str, Trajectory], settings: PcmSettings) -> BoolArray:
    """Which closures within one robot `(N,)` its own odometry allows, given how far it may have drifted."""
    odometry = trajectories[z.robot_a]
    x = odometry.relative_pose(z.index_a, z.index_b)
    error = se3.log(se3.between(z.T_a_b, x))
    if settings.metric == "unit":
        return np.asarray(np.linalg.norm(error, axis=1) < settings.unit_threshold)
    sigma = se3.inverse_covariance(z.T_a_b, z.covariance)
    sigma = se3.compose_covariance(sigma, x, odometry.relative_covariance(z.index_a, z.index_b))
    return np.asarray(mahalanobis_squared(error, sigma) < chi_square_limit(settings.probability))


@cache
def chi_square_limit(probability: float) -> float:
    """Quantile of chi-square with the 6 degrees of freedom of a rigid transform."""
    return float(chi2.ppf(probability, 6))


# --------------------------------------------------------------------------------------------------------- judgement
def _judge(
    z: ClosureSet, consistent: BoolArray, places: FloatArray | None, settings: PcmSettings
) -> tuple[PairConsistency, dict[int, tuple[Decision, str]]]:
    """Finds the largest set of one pair of robots and decides whether to believe it.

    `places (2, N, 3)` are where the closures lie on either robot's path, None where a prediction supports some.
    """
    best = max_clique(consistent, time_budget_s=settings.time_budget_s)
    members = np.zeros(len(z), bool)
    members[list(best.members)] = True
    rival = _rival(consistent, members, settings)
    doubt = _doubt(z, consistent, members, rival, settings) or _one_place(z, members, places, settings)
    verdicts = _verdicts(z, consistent, members, doubt)
    kept = 0 if doubt else len(best)
    sentence = f"{z.name}: " + (doubt or f"{kept} of {len(z)} closures agree and are accepted")
    if not best.proven:
        sentence += f" (the search for a larger set was stopped after {settings.time_budget_s:g} s)"
    return PairConsistency(z.robot_a, z.robot_b, len(z), kept, len(best), len(rival), best.proven, sentence), verdicts


def _rival(consistent: BoolArray, members: BoolArray, settings: PcmSettings) -> Clique:
    """The largest set among the closures that contradict more than half of the best set."""
    others = np.flatnonzero(~members & (2 * consistent[:, members].sum(axis=1) < members.sum()))
    inside = max_clique(consistent[np.ix_(others, others)], time_budget_s=settings.time_budget_s)
    return Clique(tuple(int(others[v]) for v in inside.members), inside.proven)


def _doubt(z: ClosureSet, consistent: BoolArray, members: BoolArray, rival: Clique, settings: PcmSettings) -> str:
    """Why the largest set is not believed; empty if it is."""
    size, total = int(members.sum()), len(z)
    needed = settings.min_clique_size if z.between_robots else 1  # odometry has vouched for one within a robot
    if size < needed:
        return _too_few(size, total, needed)
    if total < settings.start_threshold:
        return f"{total} closures are fewer than the {settings.start_threshold} that pcm.start_threshold asks for"
    if not settings.guard or not z.between_robots:
        return ""
    if len(rival) >= size:
        return f"ambiguous, two sets of {size} closures contradict each other"
    if chance_sets(consistent, members, settings.chance) > BELIEVABLE_CHANCE:
        return f"the largest set has {size} of {total} closures, which chance could explain"
    return ""


def _places(z: ClosureSet, trajectories: Mapping[str, Trajectory]) -> FloatArray:
    """Positions `(2, N, 3)` of the closures' ends, each in its robot's odometry frame."""
    ends = ((z.robot_a, z.index_a), (z.robot_b, z.index_b))
    return np.stack([trajectories[robot].positions[index] for robot, index in ends])


def _one_place(z: ClosureSet, members: BoolArray, places: FloatArray | None, settings: PcmSettings) -> str:
    """Whether the set is of one place only, which a look-alike place would give as well; empty if it is not."""
    if places is None or not settings.guard or not z.between_robots:
        return ""
    extent_m = float(np.linalg.norm(np.ptp(places[:, members], axis=1), axis=1).min())
    if extent_m >= settings.min_extent_m:
        return ""
    return (
        f"all {int(members.sum())} closures that agree lie within {extent_m:.1f} m, as those of one look-alike place"
        f" would; {settings.min_extent_m:g} m are needed without a prediction (pcm.min_extent_m)"
    )


def _too_few(size: int, total: int, needed: int) -> str:
    if total == 0:
        return "no closure left to check"
    if total == 1:
        return "a single closure cannot be checked"
    found = "no two" if size == 1 else f"no more than {size}"
    return f"{found} of the {total} closures agree, {needed} must"


def chance_sets(consistent: BoolArray, members: BoolArray, chance: float) -> float:
    """How many sets as large as `members (N,)` to expect if pairs agreed by chance only.

    Cliques of size k among n vertices of a random graph: `C(n, k) p^(k (k - 1) / 2)`.  p is the share of agreeing pairs
    outside the set, and at least `chance`.
    """
    size, total = int(members.sum()), len(members)
    pairs_outside = comb(total, 2) - comb(size, 2)
    agreeing_outside = int(consistent.sum()) // 2 - comb(size, 2)
    p = max(chance, agreeing_outside / pairs_outside if pairs_outside else 0.0)
    return float(np.exp(min(np.log(float(comb(total, size))) + comb(size, 2) * np.log(p), 700.0)))


def _verdicts(z: ClosureSet, consistent: BoolArray, members: BoolArray, doubt: str) -> dict[int, tuple[Decision, str]]:
    """Decision and reason by row of the closure list."""
    if doubt:
        return {int(row): (Decision.REJECTED, doubt) for row in z.rows}
    size = int(members.sum())
    support = consistent[:, members].sum(axis=1)
    return {
        int(row): (Decision.ACCEPTED, f"one of {size} closures that agree")
        if member
        else (
            Decision.REJECTED,
            f"inconsistent with the {size} closures of the largest consistent set (agrees with {agrees})",
        )
        for row, member, agrees in zip(z.rows, members, support, strict=True)
    }
