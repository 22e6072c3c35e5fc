"""Robots become groups, groups one map: sets of closures that agree join them, and every closure is judged by the rest.

Each round compares all closures between two groups (of whichever of their robots), so that closures of different pairs
of robots check each other over third robots; sets that hold join their groups, and the joined groups are estimated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import networkx as nx
import numpy as np

from wiclosure import se3
from wiclosure.backends import sigma_scale
from wiclosure.backends.alignment import Comparison
from wiclosure.backends.claims import Claims
from wiclosure.backends.edges import Edges, mahalanobis_squared
from wiclosure.backends.hypotheses import EXPECTED_BY_CHANCE, Candidate, Places, settle_cycles
from wiclosure.backends.settling import Settled, graduated, outlier_limit, settle
from wiclosure.types import BoolArray, FloatArray, IntArray

PLACE_PAIRS = 50  # pairs of places among which two may look alike: a seventh of both paths is not one of them
VIEW_STEPS = 10.0  # steps of odometry between scans that see the same: it is odometry that matched them

REFINEMENTS = 4  # of the scale of sigma
TELLING_PAIRS = 50  # of robots, those with most closures, that tell the scale


@dataclass(frozen=True, eq=False)
class Robots:
    """A team as arrays.

    Args:
        robot: `(N,)` robot of each node, numbered; nodes of one robot follow each other.
        poses: `(N, 4, 4)` by odometry, each robot in its own frame.
        odometry: edges between consecutive nodes.
        loops: all closures `(M,)`.
        predicted: `(M,)` closures that a prediction supports.
    """

    robot: IntArray
    poses: FloatArray
    odometry: Edges
    loops: Edges
    predicted: BoolArray

    @property
    def count(self) -> int:
        """Of robots."""
        return int(self.robot[-1]) + 1

    @property
    def own(self) -> BoolArray:
        """Closures `(M,)` within one robot."""
        return np.asarray(self.robot[self.loops.first] == self.robot[self.loops.second])

    def groups_of_ends(self, group: IntArray) -> tuple[IntArray, IntArray]:
        """Group of both ends of each closure, by the group `(R,)` of each robot."""
        return group[self.robot[self.loops.first]], group[self.robot[self.loops.second]]

    @property
    def first_nodes(self) -> IntArray:
        """Of each robot."""
        return np.flatnonzero(np.r_[True, self.robot[1:] != self.robot[:-1]])

    def path_lengths(self) -> FloatArray:
        """Metres that each robot travelled."""
        step = np.linalg.norm(self.odometry.T[:, :3, 3], axis=1)
        return np.bincount(self.robot[self.odometry.first], step, minlength=self.count)

    def scaled(self, scale: float) -> Robots:
        """All standard deviations so many times as large."""
        odometry, loops = (Edges(e.first, e.second, e.T, scale**2 * e.covariance) for e in (self.odometry, self.loops))
        return Robots(self.robot, self.poses, odometry, loops, self.predicted)


@dataclass(eq=False)
class Merged:
    """What came of it.

    Args:
        inlier: `(M,)` closures that are accepted.
        group: `(R,)` of each robot.
        reason: by closure, where it is rejected.
        candidates: sets between robots of the first round.
        settled: the estimate within the groups.
        scale: factor on all standard deviations.
    """

    inlier: BoolArray
    group: IntArray
    reason: dict[int, str]
    candidates: list[Candidate]
    settled: Settled
    scale: float


@dataclass(frozen=True)
class MergeSettings:
    """How to decide.

    Args:
        agree_limit: squared distance within which two closures agree.
        probability: that none of the true closures is taken for an outlier.
        rival_share: a set that contradicts another of the same pair and has this share of its size leaves it open.
        min_size: closures that a set must have.
        most_scale: standard deviations may be stated so many times too small or too large; 1 takes them as they are.
    """

    agree_limit: float
    probability: float = 0.99
    rival_share: float = 0.8
    min_size: int = 2
    most_scale: float = 1.0


def merge(robots: Robots, settings: MergeSettings) -> Merged:
    """Joins robots until nothing joins any more, with the scale of sigma that fits what is found."""
    own = robots.own
    everything = settle(robots.odometry, robots.loops, own, own, robots.poses, robots.first_nodes, np.inf)
    if settings.most_scale <= 1:
        return _merged(robots, settings, everything, 1.0)
    scale = _scale(robots, settings, everything)
    merged = _merged(robots, settings, everything, scale)
    left = sigma_scale.of_residuals(merged.settled.redundant)
    better = sigma_scale.settled(scale * (left or 1.0), settings.most_scale)
    if 1 / sigma_scale.NO_MATTER <= better / scale <= sigma_scale.NO_MATTER:
        return merged
    return _merged(robots, settings, everything, better)


def _scale(robots: Robots, settings: MergeSettings, everything: Settled) -> float:
    """Of what robots say within themselves; else of the sets between them."""
    most, limit = settings.most_scale, outlier_limit(len(robots.loops), settings.probability)
    known, scale = sigma_scale.of_residuals(everything.redundant), most
    for _ in range(REFINEMENTS if known is not None else 0):
        before, scale = scale, sigma_scale.settled(float(known), most)
        if scale > before / sigma_scale.NO_MATTER:  # no smaller: what is left are inliers
            return scale
        left = sigma_scale.of_residuals(_own(robots.scaled(scale), everything.scaled(scale), limit).redundant)
        if left is None:
            break
        known = scale * left
    if known is not None:
        return scale
    settled = _own(robots.scaled(most), everything.scaled(most), limit).scaled(1.0 / most)
    alone = np.arange(robots.count)
    largest = sorted(_pairs(robots, alone), key=len, reverse=True)[:TELLING_PAIRS]
    comparisons = [Comparison.of(_claims(robots, rows, alone, settled)[0]) for rows in largest]
    return sigma_scale.settled(sigma_scale.of_sets(comparisons, settings.agree_limit, most), most)


def _own(robots: Robots, everything: Settled, limit: float) -> Settled:
    """Each robot by its own loops: all of them, where none contradicts the others."""
    own = robots.own
    if not (everything.distance[own] > limit).any():
        return everything
    inlier = own.copy()
    inlier[own], poses = graduated(
        robots.odometry, robots.loops.subset(own), robots.poses, robots.first_nodes, limit
    )
    return settle(robots.odometry, robots.loops, inlier, own, poses, robots.first_nodes, limit)


def _merged(robots: Robots, settings: MergeSettings, everything: Settled, scale: float) -> Merged:
    """Round after round."""
    limit, robots = outlier_limit(len(robots.loops), settings.probability), robots.scaled(scale)
    group, settled = np.arange(robots.count), _own(robots, everything.scaled(scale), limit)
    of_robots: list[Candidate] | None = None
    while True:
        candidates = [c for rows in _pairs(robots, group) for c in _of_pair(robots, rows, group, settled, settings)]
        settle_cycles(candidates, _places(robots, group, settled), settings.agree_limit, settings.rival_share)
        of_robots = candidates if of_robots is None else of_robots
        holding = [c for c in candidates if c.holds]
        if not holding:
            break
        group, poses, joined = _joined(robots, group, settled, holding, settings.agree_limit)
        ends = robots.groups_of_ends(group)
        inside = ends[0] == ends[1]
        inlier = settled.inlier.copy()
        inlier[joined] = True
        held = np.array([robots.first_nodes[np.flatnonzero(group == g)[0]] for g in np.unique(group)])
        settled = settle(robots.odometry, robots.loops, inlier & inside, inside, poses, held, limit)
    reasons = _reasons(robots, group, settled, candidates)
    return Merged(settled.inlier, group, reasons, of_robots, settled, scale)


def _pairs(robots: Robots, group: IntArray) -> list[IntArray]:
    """Rows of the closures between each two groups."""
    first, second = robots.groups_of_ends(group)
    between = np.flatnonzero(first != second)
    if len(between) == 0:
        return []
    low, high = np.minimum(first, second)[between], np.maximum(first, second)[between]
    order = np.lexsort((high, low))
    pair = (low * len(group) + high)[order]
    return np.split(between[order], np.flatnonzero(np.diff(pair)) + 1)


def _claims(robots: Robots, rows: IntArray, group: IntArray, settled: Settled) -> tuple[Claims, int, int]:
    """The closures between two groups, all from the lower to the higher."""
    loops, (first, second) = robots.loops.subset(rows), robots.groups_of_ends(group)
    turned = first[rows] > second[rows]
    T, covariance = loops.T.copy(), loops.covariance.copy()
    covariance[turned] = se3.inverse_covariance(T[turned], covariance[turned])
    T[turned] = se3.inverse(T[turned])
    a, b = np.where(turned, loops.second, loops.first), np.where(turned, loops.first, loops.second)
    claims = Claims(settled.poses[a], settled.poses[b], T, covariance, settled.wander[a], settled.wander[b])
    low, high = sorted((int(first[rows[0]]), int(second[rows[0]])))
    return claims, low, high


def _of_pair(
    robots: Robots, rows: IntArray, group: IntArray, settled: Settled, settings: MergeSettings
) -> list[Candidate]:
    """Sets between two groups, with the doubts that the pair alone leaves."""
    claims, a, b = _claims(robots, rows, group, settled)
    comparison = Comparison.of(claims)
    hypotheses = comparison.hypotheses(settings.agree_limit)
    found = [Candidate(a, b, rows[h.rows], h, comparison) for h in hypotheses]
    for candidate in found:
        candidate.extent = _extent(robots, candidate)
        candidate.doubt = _doubt(robots, candidate, group, settings.min_size)
    _rivals(found, settings.rival_share)
    return found


def _places(robots: Robots, group: IntArray, settled: Settled) -> Places:
    """Where closures of each group could be."""
    of_node = group[robots.robot]
    return {int(g): (settled.poses[of_node == g], settled.wander[of_node == g]) for g in np.unique(group)}


def _extent(robots: Robots, candidate: Candidate) -> float:
    """How far the closures' ends lie apart on either path, by how far apart scans still match."""
    claims = candidate.comparison.claims.subset(candidate.hypothesis.rows)
    reach = max(float(np.median(np.linalg.norm(claims.T_a_b[:, :3, 3], axis=1))), VIEW_STEPS * _step(robots))
    return _span(candidate) / max(reach, 1e-9)


def _span(candidate: Candidate) -> float:
    """The same in metres."""
    claims = candidate.comparison.claims.subset(candidate.hypothesis.rows)
    return max(float(np.linalg.norm(np.ptp(T[:, :3, 3], axis=0))) for T in (claims.T_A_a, claims.T_B_b))


def _doubt(robots: Robots, candidate: Candidate, group: IntArray, min_size: int) -> str:
    """Too few, chance, or one place that may look like another; empty if the pair alone settles it."""
    size, total = len(candidate), candidate.hypothesis.total
    if size == 1:
        return "a single closure cannot be checked" if total == 1 else f"no two of the {total} closures agree"
    if size < min_size:
        return f"no more than {size} of the {total} closures agree, {min_size} must"
    if candidate.hypothesis.log_chance > np.log(EXPECTED_BY_CHANCE):
        return f"the largest set has {size} of {total} closures, which chance could explain"
    lengths = robots.path_lengths()
    length_a, length_b = (float(lengths[group == g].sum()) for g in (candidate.a, candidate.b))
    span = _span(candidate)
    covered = span**2 * PLACE_PAIRS >= length_a * length_b
    if candidate.extent >= 1 or covered or robots.predicted[candidate.rows].any():
        return ""
    return (
        f"all {size} closures that agree lie within {span:.1f} m, as those of one look-alike place would;"
        " nothing else supports them"
    )


def _step(robots: Robots) -> float:
    """Median distance, m, between consecutive nodes."""
    return float(np.median(np.linalg.norm(robots.odometry.T[:, :3, 3], axis=1))) if len(robots.odometry) else 0.0


def _rivals(found: Sequence[Candidate], rival_share: float) -> None:
    """Two sets of one pair that contradict each other and are alike in size leave it open."""
    sure = [c for c in found if not c.doubt]
    if len(sure) < 2:
        return
    largest, rival = sorted(sure, key=len, reverse=True)[:2]
    close = len(rival) >= rival_share * len(largest)
    sizes = f"of {len(largest)}" if len(largest) == len(rival) else f"of {len(largest)} and {len(rival)}"
    for candidate in sure:
        if close:
            candidate.doubt = f"ambiguous, two sets {sizes} closures contradict each other; neither is believed"
        elif candidate is not largest:
            candidate.doubt = f"inconsistent with the {len(largest)} closures of the largest consistent set"


def _joined(
    robots: Robots, group: IntArray, settled: Settled, holding: Sequence[Candidate], limit: float
) -> tuple[IntArray, FloatArray, IntArray]:
    """New groups, poses in their frames, and the closures of the sets that joined them or agree with those."""
    best: dict[tuple[int, int], Candidate] = {}
    for candidate in sorted(holding, key=lambda c: (c.support, len(c))):
        best[candidate.a, candidate.b] = candidate
    graph: nx.Graph[int] = nx.Graph()
    graph.add_nodes_from(np.unique(group).tolist())
    for (a, b), candidate in best.items():
        graph.add_edge(a, b, weight=(candidate.support + len(candidate)), candidate=candidate)
    tree = nx.maximum_spanning_tree(graph, weight="weight")
    frames: dict[int, FloatArray] = {}
    new_group = group.copy()
    for component in sorted(nx.connected_components(tree), key=min):
        root = min(component)
        frames[root] = np.eye(4)
        for parent, child in nx.bfs_edges(tree, root):
            of = best[min(parent, child), max(parent, child)]
            frames[child] = frames[parent] @ (of.frame if parent == of.a else se3.inverse(of.frame))
        new_group[np.isin(group, list(component))] = root
    T = np.stack([frames[int(g)] for g in group[robots.robot]])
    agreeing = [c for c in best.values() if tree.has_edge(c.a, c.b) or _agrees(c, frames, limit)]
    return new_group, T @ settled.poses, np.concatenate([c.rows for c in agreeing])


def _agrees(candidate: Candidate, frames: dict[int, FloatArray], limit: float) -> bool:
    """Whether a set agrees with where the others put its groups, its own uncertainty alone counted twice."""
    error = se3.log(se3.between(candidate.frame, se3.between(frames[candidate.a], frames[candidate.b])))
    covariance = candidate.noise + candidate.wander @ candidate.wander.T
    return bool(mahalanobis_squared(error[None], 2.0 * covariance[None])[0] <= limit)


def _reasons(robots: Robots, group: IntArray, settled: Settled, last: Sequence[Candidate]) -> dict[int, str]:
    """Why closures are rejected."""
    first, second = robots.groups_of_ends(group)
    reasons: dict[int, str] = {}
    for candidate in reversed(last):
        for row in candidate.rows.tolist():
            reasons[row] = candidate.fallen or candidate.doubt
    for row in np.flatnonzero(~settled.inlier).tolist():
        if first[row] == second[row]:
            reasons[row] = f"contradicts what the other closures and odometry predict, {np.sqrt(settled.distance[row]):.1f} sigma off"
        else:
            reasons.setdefault(row, "no other closure agrees with it")
    return reasons
