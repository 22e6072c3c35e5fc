"""Sets of closures between two groups of robots, and what speaks against each within the pair."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wiclosure import se3
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import Settled
from wiclosure.backends.sets.alignment import ClosureComparison
from wiclosure.backends.sets.candidate_sets import (
    EXPECTED_BY_CHANCE,
    LEAST_COVERAGE,
    LEAST_OF_THREE,
    SATURATED,
    CandidateSet,
    Places,
)
from wiclosure.backends.sets.claims import Claims
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.types import BoolArray, IntArray

MOST_KEPT = 4  # sets of a pair of groups, of those found: cycles are made of three each


def pairs_of_groups(robots: Robots, group: IntArray) -> list[IntArray]:
    """Rows of the closures between each two groups."""
    first, second = robots.groups_of_ends(group)
    between = np.flatnonzero(first != second)
    if len(between) == 0:
        return []
    low, high = np.minimum(first, second)[between], np.maximum(first, second)[between]
    order = np.lexsort((high, low))
    pair = (low * len(group) + high)[order]
    return np.split(between[order], np.flatnonzero(np.diff(pair)) + 1)


def claims_between(robots: Robots, rows: IntArray, group: IntArray, settled: Settled) -> Claims:
    """The closures between two groups, all from the lower to the higher."""
    loops = robots.loops.subset(rows)
    first, second = group[robots.robot[loops.first]], group[robots.robot[loops.second]]
    turned = first > second
    T, covariance = loops.T.copy(), loops.covariance.copy()
    covariance[turned] = se3.inverse_covariance(T[turned], covariance[turned])
    T[turned] = se3.inverse(T[turned])
    a, b = np.where(turned, loops.second, loops.first), np.where(turned, loops.first, loops.second)
    return Claims(settled.poses[a], settled.poses[b], T, covariance, settled.wander[a], settled.wander[b])


def sets_between(
    robots: Robots,
    rows: IntArray,
    group: IntArray,
    settled: Settled,
    settings: MergeSettings,
    known: ClosureComparison | None = None,
) -> list[CandidateSet]:
    """Sets between two groups, with what speaks against each within the pair; the comparison may be known."""
    comparison = known or ClosureComparison.of(claims_between(robots, rows, group, settled), settings.agree_limit)
    a, b = sorted(group[robots.robot[robots.loop_ends[:, rows[0]]]].tolist())
    consistent_sets = comparison.consistent_sets(settings.agree_limit)
    found = [CandidateSet(a, b, rows[h.rows], h, comparison) for h in consistent_sets]
    for candidate in found:
        _check_by_itself(robots, candidate, group, settled, settings)
    found = _most_telling(found)
    _compare_sizes(found, settings.ambiguous_share)
    return found


def stands(
    robots: Robots,
    candidate: CandidateSet,
    inlier: BoolArray,
    group: IntArray,
    settled: Settled,
    settings: MergeSettings,
) -> bool:
    """Whether what an estimate by `inlier (M,)` has left of a set between `group` would hold by the same rules."""
    kept = inlier[candidate.rows]
    if kept.all() or not kept.any():
        return bool(kept.all())
    left = candidate.subset(kept)
    _check_by_itself(robots, left, group, settled, settings)
    return left.holds


def _check_by_itself(
    robots: Robots, candidate: CandidateSet, group: IntArray, settled: Settled, settings: MergeSettings
) -> None:
    """What there is to say for and against a set, were it the only one of its pair."""
    candidate.coverage = _coverage(robots, candidate, group, settled)
    view_m = settings.view_steps * robots.step_m
    candidate.places = count_places(robots, candidate.rows, view_m, SATURATED)
    candidate.objection = _objection(candidate, settings.min_size)
    if not candidate.objection:
        candidate.objection = _of_one_place(robots, candidate, view_m)
        candidate.one_place = bool(candidate.objection)


def places_of_groups(robots: Robots, group: IntArray, settled: Settled) -> Places:
    """Where closures of each group could be."""
    of_node = group[robots.robot]
    return {int(g): (settled.poses[of_node == g], settled.wander[of_node == g]) for g in np.unique(group)}


def _span(candidate: CandidateSet) -> float:
    """How far apart the closures' ends lie in space on either path, m."""
    claims, rows = candidate.comparison.claims, candidate.closure_set.rows
    return max(float(np.linalg.norm(np.ptp(T[rows, :3, 3], axis=0))) for T in (claims.T_A_a, claims.T_B_b))


def _views(candidate: CandidateSet, span: float, view_m: float) -> float:
    """The span by how far apart scans still match: as far as a view reaches, or as far as these do."""
    T_a_b = candidate.comparison.claims.T_a_b[candidate.closure_set.rows]
    reach = max(float(np.median(np.linalg.norm(T_a_b[:, :3, 3], axis=1))), view_m)
    return span / max(reach, 1e-9)


def _coverage(robots: Robots, candidate: CandidateSet, group: IntArray, settled: Settled) -> float:
    """Share of both paths that the closures' ends span, the geometric mean of the two: in space or along, the smaller.

    A path that winds about a field spans it anywhere.  Paths of robots that no closure touches do not count.
    """
    nodes = np.concatenate([robots.loops.first[candidate.rows], robots.loops.second[candidate.rows]])
    touched = np.unique(robots.robot[nodes])
    stretches, lengths, extents = np.zeros(2), np.zeros(2), np.zeros(2)
    for side, of_side in enumerate((candidate.a, candidate.b)):
        members = touched[group[touched] == of_side]
        lengths[side] = robots.length_m[members].sum()
        stretches[side] = sum(np.ptp(robots.along_m[nodes[robots.robot[nodes] == robot]]) for robot in members)
        positions = settled.poses[robots.nodes_of(members), :3, 3]
        extents[side] = np.linalg.norm(np.ptp(positions, axis=0))
    along = stretches.max() / max(float(np.sqrt(lengths.prod())), 1e-9)
    return min(1.0, float(along), _span(candidate) / max(float(np.sqrt(extents.prod())), 1e-9))


def count_places(robots: Robots, rows: IntArray, view_m: float, most: int | None = None) -> int:
    """How many closures, up to `most`, of those at `rows` lie no view apart from each other along either path."""
    left = np.stack([robots.loops.first[rows], robots.loops.second[rows]], axis=1)
    left = left[np.lexsort((left[:, 1], left[:, 0]))]
    count = 0
    while len(left) and (most is None or count < most):
        near = (robots.robot[left] == robots.robot[left[0]]).all(axis=1)
        near &= (np.abs(robots.along_m[left] - robots.along_m[left[0]]) < max(view_m, 1e-9)).all(axis=1)
        left, count = left[~near], count + 1
    return max(count, 1)


def _objection(candidate: CandidateSet, min_size: int) -> str:
    """Too few, or chance; empty if they agree for a reason."""
    size, total = len(candidate), candidate.closure_set.total
    if size == 1:
        return "a single closure cannot be checked" if total == 1 else f"no two of the {total} closures agree"
    if size < min_size:
        return f"no more than {size} of the {total} closures agree, {min_size} must"
    if candidate.closure_set.by_chance(EXPECTED_BY_CHANCE):
        return f"the largest set has {size} of {total} closures, which chance could explain"
    return ""


def _of_one_place(robots: Robots, candidate: CandidateSet, view_m: float) -> str:
    """One place that may look like another; empty if the pair alone settles it."""
    size, span = len(candidate), _span(candidate)
    needed = LEAST_OF_THREE if size <= 3 else LEAST_COVERAGE
    if candidate.coverage >= needed or _views(candidate, span, view_m) >= 1 or robots.predicted[candidate.rows].any():
        return ""
    return (
        f"all {size} closures that agree lie within {span:.1f} m, as those of one look-alike place would;"
        " nothing else supports them"
    )


def _most_telling(found: Sequence[CandidateSet]) -> list[CandidateSet]:
    """The few largest, those first that nothing speaks against within the pair; single closures are few anyway."""
    several = sorted((c for c in found if len(c) > 1), key=lambda c: (not c.objection, len(c)), reverse=True)
    return [*several[:MOST_KEPT], *(c for c in found if len(c) == 1)]


def _compare_sizes(found: Sequence[CandidateSet], ambiguous_share: float) -> None:
    """Two sets of one pair that contradict each other and are alike in size leave it open."""
    sure = [c for c in found if not c.objection]
    if len(sure) < 2:
        return
    largest, contradicting = sorted(sure, key=len, reverse=True)[:2]
    close = len(contradicting) >= ambiguous_share * len(largest)
    sizes = (
        f"of {len(largest)}" if len(largest) == len(contradicting) else f"of {len(largest)} and {len(contradicting)}"
    )
    for candidate in sure:
        candidate.rivalled = close or candidate is not largest
        if close:
            candidate.objection = f"ambiguous, two sets {sizes} closures contradict each other; neither is accepted"
        elif candidate is not largest:
            candidate.objection = f"inconsistent with the {len(largest)} closures of the largest consistent set"
