"""Where odometry may have jumped: closures that agree are rejected on one side of a place, others accepted before."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import hypergeom

from wiclosure.backends.consistency.explanation import Explanation
from wiclosure.backends.consistency.merging import MergedGroups, settled_within
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import outlier_limit
from wiclosure.backends.sets.candidate_sets import EXPECTED_BY_CHANCE
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.pair_sets import pairs_of_groups, sets_between
from wiclosure.types import BoolArray, FloatArray, IntArray


def place_to_cut(robots: Robots, merged: MergedGroups, nodes: IntArray, settings: MergeSettings) -> int | None:
    """The node, of these of one robot, before which odometry may have jumped; None if nothing speaks for it.

    Args:
        robots: with standard deviations as `merged` found them.
        merged: the team.
        nodes: of one robot of the uncut team.
        settings: of the merge.
    """
    places: list[tuple[float, int]] = []
    for part in np.unique(robots.robot[nodes]):
        of_part = np.flatnonzero(robots.robot == part)
        chance, splits = _chances_of_splits(robots, merged, int(part))
        if len(splits) and chance.min() <= EXPECTED_BY_CHANCE:
            least = float(chance.min())
            places += [(least, _by_own_loops(robots, merged, of_part, splits[chance <= least * (1 + 1e-9)]))]
    for _, node in sorted(places):
        if robots.steps_across(node).sum() == 1 and _set_holds(robots, merged, node, settings):
            return node
    return None


def most_strained(robots: Robots, merged: MergedGroups, nodes: IntArray) -> int | None:
    """The node, of these of one robot, the step of odometry to which bends the estimate most; None if chance may."""
    steps, strain = robots.odometry, merged.settled.strain
    of_robot = np.flatnonzero(np.isin(steps.second, nodes))
    if not len(of_robot):
        return None
    worst = of_robot[np.argmax(strain[of_robot])]
    if strain[worst] <= outlier_limit(len(steps), 1.0 - EXPECTED_BY_CHANCE, robots.degrees):
        return None
    node = int(steps.second[worst])
    return node if robots.steps_across(node).sum() == 1 else None


def bending_most(found: Explanation, settings: MergeSettings) -> list[tuple[Explanation, int]]:
    """The node to which odometry's step bends the estimate most, and what follows without it; none if not by much.

    By more than taking one look-alike place for true costs.  By the same closures: if the robot were cut there, those
    of its parts might hold these too loosely to be accepted anew.
    """
    robots, merged = found.robots, found.merged
    strain = merged.settled.strain
    if strain.max(initial=0.0) <= found.one_place(settings):
        return []
    node = int(robots.odometry.second[np.argmax(strain)])
    if robots.steps_across(node).sum() != 1:
        return []
    group = _group_of_parts(robots, merged, node)
    apart = merged.restated(robots).cut(node)
    settled = settled_within(apart, group, merged.inlier, merged.settled.poses, np.inf)
    without = replace(merged, group=group, settled=settled)
    return [(Explanation(robots.cut(node), without, (*found.nodes, node)), node)]


def _group_of_parts(robots: Robots, merged: MergedGroups, node: int) -> IntArray:
    """Of each robot, with that of the node cut there; numbers of groups are those of their robots."""
    part = int(robots.robot[node])
    group = np.insert(merged.group, part + 1, merged.group[part])
    return np.where(group > part, group + 1, group)


def _chances_of_splits(robots: Robots, merged: MergedGroups, robot: int) -> tuple[FloatArray, IntArray]:
    """By node from which on a robot could be cut: that chance parts rejected closures from others so, of all nodes.

    Fisher's exact test, for either side, times the number of nodes.
    """
    ends = robots.robot[robots.loop_ends] == robot
    rows = np.flatnonzero(ends[0] != ends[1])
    node = np.where(ends[0], robots.loops.first, robots.loops.second)[rows]
    accepted = merged.inlier[rows]
    if not accepted.any():  # it joins nobody: its largest set against the others
        sets = [c.rows for c in merged.candidates if robot in (c.a, c.b)]
        accepted = np.isin(rows, max(sets, key=len)) if sets else accepted
    splits = np.flatnonzero(robots.robot == robot)[1:]
    before, rejected = np.searchsorted(np.sort(node), splits), np.searchsorted(np.sort(node[~accepted]), splits)
    total, of_rejected = len(rows), int((~accepted).sum())
    more = hypergeom.sf(rejected - 1, total, of_rejected, before)
    fewer = hypergeom.cdf(rejected, total, of_rejected, before)
    return np.asarray(2.0 * len(splits) * np.minimum(more, fewer)), splits


def _by_own_loops(robots: Robots, merged: MergedGroups, of_part: IntArray, splits: IntArray) -> int:
    """The one of these nodes that fewest accepted loops of the robot, and most rejected ones, reach across."""
    first, second = robots.loops.first, robots.loops.second
    own = np.isin(first, of_part) & np.isin(second, of_part)
    low, high = np.minimum(first, second)[own], np.maximum(first, second)[own]
    accepted = merged.inlier[own]

    def across(of: BoolArray) -> IntArray:
        return np.searchsorted(np.sort(low[of]), splits) - np.searchsorted(np.sort(high[of]), splits)

    return int(splits[np.argmin(across(accepted) - across(~accepted))])


def _set_holds(robots: Robots, merged: MergedGroups, node: int, settings: MergeSettings) -> bool:
    """Whether, with a cut there, rejected closures of either part make a set that holds by itself."""
    part, group = int(robots.robot[node]), _group_of_parts(robots, merged, node)
    robots = robots.cut(node)
    for alone in (part, part + 1):
        apart = group.copy()
        apart[alone] = robots.count
        touching = (robots.robot[robots.loop_ends] == alone).any(axis=0)
        rejected = touching & ~merged.inlier
        for pair in pairs_of_groups(robots, apart):
            rows = pair[rejected[pair]]
            if len(rows) >= max(settings.min_size, 1) and any(
                c.holds for c in sets_between(robots, rows, apart, merged.settled, settings)
            ):
                return True
    return False
