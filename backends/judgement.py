"""Whether the largest consistent set of one pair of robots is believed, and what is said of every closure."""

from __future__ import annotations

from dataclasses import dataclass
from math import comb, log

import numpy as np

from wiclosure.backends.closure_sets import ClosureSet, Verdict
from wiclosure.backends.config import PcmSettings
from wiclosure.max_clique import Clique, max_clique
from wiclosure.types import BoolArray, FloatArray

BELIEVABLE_CHANCE = 0.05  # expected number of sets as large that chance alone would make


@dataclass(frozen=True, slots=True)
class PairConsistency:
    """What PCM found between two robots.

    Args:
        robot_a, robot_b: the robots; the same name twice for closures within one robot.
        considered: closures that were checked.
        kept: size of the set believed; 0 if none is.
        largest: size of the largest consistent set, or of the heaviest (`PcmSettings.weight`).
        rival: size of the largest set among the closures that mostly contradict it.
        proven: false if the time ran out before a larger set was excluded.
        ambiguous: the rival is nearly as large, so that neither is believed.
        sentence: the same for the user.
    """

    robot_a: str
    robot_b: str
    considered: int
    kept: int
    largest: int
    rival: int
    proven: bool
    ambiguous: bool
    sentence: str


Verdicts = dict[int, Verdict]
"""By row of the closure list."""


def judge(
    z: ClosureSet, consistent: BoolArray, places: FloatArray | None, settings: PcmSettings
) -> tuple[PairConsistency, Verdicts]:
    """Finds the largest set of one pair of robots and decides whether to believe it.

    Args:
        z: the closures.
        consistent: `(N, N)`, which of them agree.
        places: `(2, N, 3)`, where they lie on either robot's path; None where a prediction supports some.
        settings: see `PcmSettings`.
    """
    weights = z.weight if settings.weight == "structure" else None
    best, members = _best(consistent, weights, settings)
    if weights is not None and (_too_small(z, members, settings) or _chance(z, consistent, members, settings)):
        # However good a few closures are, by themselves they prove nothing: then number counts.
        weights = None
        best, members = _best(consistent, weights, settings)
    rival = _rival(consistent, members, weights, settings)
    unclear = _ambiguous(z, best, rival, settings)
    doubt = (
        _too_small(z, members, settings) or unclear or _explained_otherwise(z, consistent, members, places, settings)
    )
    kept = 0 if doubt else len(best)
    sentence = f"{z.name}: " + (doubt or f"{kept} of {len(z)} closures agree and are accepted")
    if not best.proven:
        sentence += f" (the search for a larger set was stopped after {settings.time_budget_s:g} s)"
    report = PairConsistency(
        z.robot_a,
        z.robot_b,
        len(z),
        kept,
        len(best),
        len(rival),
        best.proven,
        bool(unclear) and doubt == unclear,
        sentence,
    )
    return report, _verdicts(z, consistent, members, doubt)


def _best(consistent: BoolArray, weights: FloatArray | None, settings: PcmSettings) -> tuple[Clique, BoolArray]:
    """The set of most weight, and which closures `(N,)` it holds."""
    best = max_clique(consistent, weights=weights, time_budget_s=settings.time_budget_s)
    members = np.zeros(len(consistent), bool)
    members[list(best.members)] = True
    return best, members


def _rival(consistent: BoolArray, members: BoolArray, weights: FloatArray | None, settings: PcmSettings) -> Clique:
    """The largest set among the closures that contradict more than half of the best set."""
    others = np.flatnonzero(~members & (2 * consistent[:, members].sum(axis=1) < members.sum()))
    own = None if weights is None else weights[others]
    inside = max_clique(consistent[np.ix_(others, others)], weights=own, time_budget_s=settings.time_budget_s)
    return Clique(tuple(int(others[v]) for v in inside.members), inside.proven, inside.weight)


def _too_small(z: ClosureSet, members: BoolArray, settings: PcmSettings) -> str:
    size, total = int(members.sum()), len(z)
    needed = settings.min_clique_size if z.between_robots else 1  # odometry has vouched for one within a robot
    if size < needed:
        return _too_few(size, total, needed)
    if total < settings.start_threshold:
        return f"{total} closures are fewer than the {settings.start_threshold} that pcm.start_threshold asks for"
    return ""


def _ambiguous(z: ClosureSet, best: Clique, rival: Clique, settings: PcmSettings) -> str:
    if not settings.guard or not z.between_robots or rival.weight < settings.rival_share * best.weight:
        return ""
    sizes = f"of {len(best)}" if len(rival) == len(best) else f"of {len(best)} and {len(rival)}"
    return f"ambiguous, two sets {sizes} closures contradict each other; neither is believed"


def _explained_otherwise(
    z: ClosureSet, consistent: BoolArray, members: BoolArray, places: FloatArray | None, settings: PcmSettings
) -> str:
    """By chance, or by one look-alike place; empty if neither."""
    if by_chance := _chance(z, consistent, members, settings):
        return by_chance
    if places is None or not settings.guard or not z.between_robots:
        return ""
    size = int(members.sum())
    extent_m = float(np.linalg.norm(np.ptp(places[:, members], axis=1), axis=1).min())
    if extent_m >= settings.min_extent_m:
        return ""
    return (
        f"all {size} closures that agree lie within {extent_m:.1f} m, as those of one look-alike place"
        f" would; {settings.min_extent_m:g} m are needed without a prediction (pcm.min_extent_m)"
    )


def _chance(z: ClosureSet, consistent: BoolArray, members: BoolArray, settings: PcmSettings) -> str:
    if not settings.guard or not z.between_robots:
        return ""
    if chance_sets(consistent, members, settings.chance) <= BELIEVABLE_CHANCE:
        return ""
    return f"the largest set has {int(members.sum())} of {len(z)} closures, which chance could explain"


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
    return float(np.exp(min(log(comb(total, size)) + comb(size, 2) * np.log(p), 700.0)))


def _verdicts(z: ClosureSet, consistent: BoolArray, members: BoolArray, doubt: str) -> Verdicts:
    if doubt:
        return {int(row): Verdict(False, doubt) for row in z.rows}
    size = int(members.sum())
    support = consistent[:, members].sum(axis=1)
    return {
        int(row): Verdict(True, f"one of {size} closures that agree")
        if member
        else Verdict(
            False,
            f"inconsistent with the {size} closures of the largest consistent set (agrees with {agrees})",
        )
        for row, member, agrees in zip(z.rows, members, support, strict=True)
    }
