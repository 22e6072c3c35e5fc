"""Odometry that jumps, as that of a robot that was carried elsewhere does: that step is not believed, all else is.

Behind a jump, closures are rejected that agree with each other, or bend the estimate.  The robot is cut there into two,
and all is merged again.  The jump is believed where that lowers the cost by more than one look-alike place would, both
parts join one group at more places than one has, no rejected closures confirm odometry's step, and no other robot's
jump explains as much.  Else it is left open.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.backends.consistency.explanation import Explanation
from wiclosure.backends.consistency.jump_places import bending_most, most_strained, place_to_cut
from wiclosure.backends.consistency.merging import MergedGroups
from wiclosure.backends.consistency.step_witnesses import step_confirmed
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import outlier_limit
from wiclosure.backends.odometry_jump import Jump
from wiclosure.backends.sets.candidate_sets import EXPECTED_BY_CHANCE, LEAST_COVERAGE, SATURATED
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.pair_sets import count_places
from wiclosure.types import IntArray

WITNESSES = 2  # robots, itself among them, that either part has closures with: one's may be of a look-alike place


@dataclass(frozen=True, eq=False)
class _Proposal:
    """Cuts of one robot, by how much they lower the cost, and whether enough speaks for them."""

    gained: float
    explanation: Explanation
    told: bool


@dataclass(frozen=True, eq=False)
class JumpDecisions:
    """What came of it.

    Args:
        merged: of the uncut team.
        cost: of the explanation, parts of robots that were cut taken apart.
        believed: jumps.
        open: those that would explain what closures say, of which nothing tells whether it is that or false closures.
    """

    merged: MergedGroups
    cost: float
    believed: list[Jump]
    open: list[Jump]


def merge_despite_jumps(found: Explanation, settings: MergeSettings) -> JumpDecisions:
    """A team of whole robots and, where closures tell of jumps, what they are."""
    robots = found.robots
    while True:
        proposals = _proposals(robots, found, settings)
        better = _undisputed(proposals, found, settings)
        if better is None:
            break
        found = better
    merged = _of_whole_robots(robots, found) if found.nodes else found.merged
    left = [(p.explanation, node) for p in proposals[:1] for node in p.explanation.nodes if node not in found.nodes]
    left = left or bending_most(found, settings)
    return JumpDecisions(
        merged,
        found.cost(settings),
        [_jump(robots, found, node) for node in sorted(found.nodes)],
        [_jump(robots, explanation, node) for explanation, node in left],
    )


def _proposals(robots: Robots, found: Explanation, settings: MergeSettings) -> list[_Proposal]:
    """Of each robot, those that explain most first."""
    proposals = []
    for robot in range(robots.count):
        cut = _with_cuts(robots, found, np.flatnonzero(robots.robot == robot), settings)
        gained = cut.gained(found, settings)
        if gained:
            new = [node for node in cut.nodes if node not in found.nodes]
            told = all(
                _joined(robots, cut, node, found, settings) and not step_confirmed(robots, cut, node, settings)
                for node in new
            )
            proposals.append(_Proposal(gained, cut, told))
    return sorted(proposals, key=lambda proposal: proposal.gained, reverse=True)


def _undisputed(proposals: list[_Proposal], found: Explanation, settings: MergeSettings) -> Explanation | None:
    """That which explains most, if enough speaks for it and no other robot's cuts explain the same about as well."""
    if not proposals or not proposals[0].told:
        return None
    best = proposals[0].explanation
    for other in proposals[1:]:
        if proposals[0].gained - other.gained > best.one_place(settings):
            break
        both = best
        for node in other.explanation.nodes:
            both = both if node in both.nodes else both.cut(node, settings)
        if not both.gained(best, settings):
            return None
    return best


def _with_cuts(robots: Robots, found: Explanation, nodes: IntArray, settings: MergeSettings) -> Explanation:
    """Cut within the nodes of one robot as long as it gains, where the estimate refutes odometry's step."""
    best = found
    while True:
        of = best.restated, best.merged, nodes
        places = place_to_cut(*of, settings), most_strained(*of)
        tried = [best.cut(node, settings) for node in dict.fromkeys(places) if node is not None]
        gained = [explanation.gained(best, settings) for explanation in tried]
        if not any(gained):
            break
        best = tried[int(np.argmax(gained))]
    needed = [node for node in best.nodes if node in found.nodes or _contradicted(robots, best, node)]
    if len(needed) < len(best.nodes):
        best = found
        for node in needed:
            best = best if node in found.nodes else best.cut(node, settings)
    return best


def _joined(robots: Robots, found: Explanation, node: int, before: Explanation, settings: MergeSettings) -> bool:
    """Whether both parts are in one group, each by closures at more places than one that looks alike has.

    Those that were rejected before must be with two robots: of one alone they may be of a long place that looks alike.
    """
    cut, merged = found.robots, found.merged
    sides = (int(cut.robot[node - 1]), int(cut.robot[node]))
    if merged.group[sides[0]] != merged.group[sides[1]]:
        return False
    ends = cut.loop_ends
    of_ends = cut.robot[ends]
    view_m = settings.view_steps * robots.step_m
    for side in sides:
        rows = np.flatnonzero(merged.inlier & ((of_ends == side).sum(axis=0) == 1))
        if not len(rows) or count_places(cut, rows, view_m, SATURATED) < SATURATED:
            return False
        span_m = np.ptp(cut.along_m[np.where(of_ends[0] == side, ends[0], ends[1])[rows]])
        if span_m < view_m:
            return False
        partners = robots.robot[np.where(of_ends[0] == side, ends[1], ends[0])[rows]]
        of_partners = [rows[partners == partner] for partner in np.unique(partners)]
        if (
            span_m < LEAST_COVERAGE * robots.length_m[robots.robot[node]]
        ):  # what looks alike there does so to all robots
            of_partners = [of for of in of_partners if count_places(cut, of, view_m, settings.min_size) > 1]
        witnesses = sum(len(of) >= settings.min_size for of in of_partners)
        if witnesses < WITNESSES and 2 * before.merged.inlier[rows].sum() <= len(rows):
            return False
    return True


def _contradicted(robots: Robots, found: Explanation, node: int) -> bool:
    """Whether the estimate refutes odometry's step to a node."""
    step = robots.scaled(found.merged.factors).odometry.subset(robots.steps_across(node))
    settled, (a, b) = found.merged.settled, (step.first, step.second)
    apart = se3.adjoint(se3.inverse(settled.poses[b])) @ (settled.wander[b] - settled.wander[a])
    covariance = step.covariance + apart @ np.swapaxes(apart, 1, 2) / apart.shape[2]
    error = se3.log(se3.between(step.T, se3.between(settled.poses[a], settled.poses[b])))
    distance = mahalanobis_squared(error, covariance)[0]
    return bool(distance > outlier_limit(len(robots.odometry), 1.0 - EXPECTED_BY_CHANCE, robots.degrees))


def _jump(robots: Robots, found: Explanation, node: int) -> Jump:
    step, poses = robots.odometry.subset(robots.steps_across(node)), found.merged.settled.poses
    error = se3.log(se3.between(step.T, se3.between(poses[step.first], poses[step.second])))[0]
    held = np.unique(robots.loop_ends[:, found.merged.inlier])
    of_ends, (before, after) = found.robots.robot[held], found.robots.robot[[node - 1, node]]
    last = held[of_ends == before].max(initial=found.robots.first_nodes[before])
    following = held[of_ends == after].min(initial=np.flatnonzero(found.robots.robot == after)[-1])
    return Jump(node, error, (int(last), int(following)))


def _of_whole_robots(robots: Robots, found: Explanation) -> MergedGroups:
    """The merge by robot, where it is by part: all parts of a robot are in one group."""
    merged, first_parts = found.merged, found.robots.robot[robots.first_nodes]
    whole = robots.robot[found.robots.first_nodes]
    factors = np.ones(robots.count)
    np.maximum.at(factors, whole, merged.odometry_factors)
    candidates = [copy(c) for c in merged.candidates if whole[c.a] != whole[c.b]]
    for candidate in candidates:
        candidate.a, candidate.b = int(whole[candidate.a]), int(whole[candidate.b])
    group = whole[merged.group[first_parts]]
    return replace(merged, group=group, candidates=candidates, odometry_factors=factors)
