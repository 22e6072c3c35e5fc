"""Whether rejected closures speak for a step of odometry that others say is a jump.

Behind a robot that was carried elsewhere no closure agrees with the odometry it had.  Where places look alike along a
stretch, true closures lie among the false ones, and agree with each other and with odometry as it is stated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from wiclosure import se3
from wiclosure.backends.consistency.explanation import Explanation
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.sets.candidate_sets import EXPECTED_BY_CHANCE
from wiclosure.backends.sets.chance import chance_to_agree
from wiclosure.backends.sets.claims import Claims
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.pair_sets import count_places
from wiclosure.types import FloatArray, IntArray

RECOMBINED = 1000  # closures, at most, that nobody measured


def step_confirmed(robots: Robots, found: Explanation, node: int, settings: MergeSettings) -> bool:
    """Whether closures that the jump rejects agree with odometry's step, at more places than chance explains.

    They must lie further from the cut than some that the jump explains: nearer ones are true where it is misplaced.

    Args:
        robots: the uncut team.
        found: the team merged, cut before `node` and perhaps elsewhere.
        node: the first behind the jump.
        settings: of the merge.
    """
    cut, inlier = found.robots, found.merged.inlier
    ends, view_m = cut.loop_ends, settings.view_steps * robots.step_m
    first, second = cut.groups_of_ends(found.merged.group)
    for side in (int(cut.robot[node - 1]), int(cut.robot[node])):
        of_side = cut.robot[ends] == side
        of_part = (of_side.sum(axis=0) == 1) & (first == second)
        from_cut = np.abs(np.where(of_side[0], ends[0], ends[1]) - node)
        nearest = from_cut[of_part & inlier].min(initial=len(cut.robot))
        rejected = np.flatnonzero(of_part & ~inlier & (from_cut > nearest))
        by_step = _ByStep.of(robots, found, node, side)
        rows = rejected[by_step.distances(rejected, rejected) <= settings.agree_limit]
        if len(rows) < settings.min_size:  # a single one may be nearer to the right place of a misplaced cut
            continue
        chance = by_step.chance(np.flatnonzero(of_part), settings.agree_limit)
        agreeing, places = (count_places(cut, of, view_m) for of in (rows, rejected))
        if binom.sf(agreeing - 1, places, chance) <= EXPECTED_BY_CHANCE:
            return True
    return False


@dataclass(frozen=True, eq=False)
class _ByStep:
    """A part of a robot where odometry's step puts it, by the rest's estimate.

    Args:
        found: the team merged, cut.
        side: the part.
        moved: how it moves, `(4, 4)`.
        wander: `(K, 6, S)` of all nodes, of the part as if it were held by the step alone.
        node: that the step ends at in the part.
        step: covariance `(6, 6)` of the step, there.
    """

    found: Explanation
    side: int
    moved: FloatArray
    wander: FloatArray
    node: int
    step: FloatArray

    @classmethod
    def of(cls, robots: Robots, found: Explanation, node: int, side: int) -> _ByStep:
        """Of the step to `node`, from the other part."""
        edge = robots.scaled(found.merged.factors).odometry.subset(robots.steps_across(node))
        poses, wander = found.merged.settled.poses, found.merged.settled.wander
        T_before_behind, covariance = edge.T[0], edge.covariance[0]
        fixed, moved = int(edge.first[0]), int(edge.second[0])
        if found.robots.robot[node] != side:
            covariance = se3.inverse_covariance(T_before_behind[None], covariance[None])[0]
            fixed, moved, T_before_behind = moved, fixed, se3.inverse(T_before_behind)
        by_step = poses[fixed] @ T_before_behind @ se3.inverse(poses[moved])
        of_part = wander[fixed] + se3.adjoint(by_step) @ (wander - wander[moved])
        return cls(found, side, by_step, of_part, moved, covariance)

    def distances(self, rows: IntArray, others: IntArray) -> FloatArray:
        """Squared distances `(K,)` of closures at `rows`, with the part's ends of those at `others`."""
        loops, merged = self.found.restated.loops, self.found.merged
        in_part = self.found.robots.robot[loops.second] == self.side
        near = np.where(in_part, loops.second, loops.first)
        a, b = np.where(in_part, loops.first, loops.second)[rows], near[others]
        T, covariance, turned = loops.T[rows], loops.covariance[rows], ~in_part[rows]
        covariance[turned] = se3.inverse_covariance(T[turned], covariance[turned])
        T[turned] = se3.inverse(T[turned])
        poses, wander = merged.settled.poses, merged.settled.wander
        covariance += se3.rotate_covariance(se3.adjoint(se3.between(poses[b], poses[self.node])), self.step)
        claims = Claims(poses[a], self.moved @ poses[b], T, covariance, wander[a], self.wander[b])
        return mahalanobis_squared(se3.log(claims.frames), claims.frame_covariance)

    def chance(self, rows: IntArray, limit: float) -> float:
        """That a closure which nobody measured, recombined of those at `rows`, agrees."""
        count, rng = len(rows), np.random.default_rng(len(rows))
        one, other = np.divmod(rng.permutation(count**2)[:RECOMBINED], count)
        unrelated = one != other
        distances = np.sort(self.distances(rows[one[unrelated]], rows[other[unrelated]]))
        return chance_to_agree(distances, limit, count, self.found.robots.degrees)
