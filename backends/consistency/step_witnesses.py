"""Whether rejected closures speak for a step of odometry that others say is a jump.

Behind a robot that was carried elsewhere no closure agrees with the odometry it had.  Where places look alike along a
stretch, true closures lie among the false ones, and agree with each other and with odometry as it is stated.
"""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.backends.consistency.explanation import Explanation
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.sets.claims import Claims
from wiclosure.backends.sets.merge_settings import MergeSettings
from wiclosure.backends.sets.pair_sets import count_places
from wiclosure.types import FloatArray, IntArray


def step_confirmed(robots: Robots, found: Explanation, node: int, settings: MergeSettings) -> bool:
    """Whether closures that the jump rejects agree with odometry's step, at more places than one that looks alike.

    They must lie further from the cut than some that the jump explains: nearer ones are true where it is misplaced.

    Args:
        robots: the uncut team.
        found: the team merged, cut before `node` and perhaps elsewhere.
        node: the first behind the jump.
        settings: of the merge.
    """
    cut, inlier = found.robots, found.merged.inlier
    ends, view_m = cut.loop_ends, settings.view_steps * robots.step_m
    for side in (int(cut.robot[node - 1]), int(cut.robot[node])):
        of_side = cut.robot[ends] == side
        of_part = of_side.sum(axis=0) == 1
        from_cut = np.abs(np.where(of_side[0], ends[0], ends[1]) - node)
        nearest = from_cut[of_part & inlier].min(initial=len(cut.robot))
        first, second = cut.groups_of_ends(found.merged.group)
        rows = np.flatnonzero(of_part & ~inlier & (first == second) & (from_cut > nearest))
        rows = rows[_distances(robots, found, node, side, rows) <= settings.agree_limit]
        if len(rows) >= settings.min_size and count_places(cut, rows, view_m, settings.min_size) > 1:
            return True
    return False


def _distances(robots: Robots, found: Explanation, node: int, side: int, rows: IntArray) -> FloatArray:
    """Squared distances `(K,)` of closures of a part from where odometry's step puts it, by the rest's estimate."""
    loops, odometry = found.restated.loops.subset(rows), robots.scaled(found.merged.factors).odometry
    edge = odometry.subset(robots.steps_across(node))
    poses, wander = found.merged.settled.poses, found.merged.settled.wander
    T_before_behind, covariance = edge.T[0], edge.covariance[0]
    fixed, moved = int(edge.first[0]), int(edge.second[0])
    if found.robots.robot[node] != side:
        covariance = se3.inverse_covariance(T_before_behind[None], covariance[None])[0]
        fixed, moved, T_before_behind = moved, fixed, se3.inverse(T_before_behind)
    in_part = found.robots.robot[loops.second] == side
    a, b = np.where(in_part, loops.first, loops.second), np.where(in_part, loops.second, loops.first)
    T, of_T = loops.T.copy(), loops.covariance.copy()
    of_T[~in_part] = se3.inverse_covariance(T[~in_part], of_T[~in_part])
    T[~in_part] = se3.inverse(T[~in_part])
    by_step = poses[fixed] @ T_before_behind @ se3.inverse(poses[moved])
    wander_b = wander[fixed] + se3.adjoint(by_step) @ (wander[b] - wander[moved])
    of_T += se3.rotate_covariance(se3.adjoint(se3.between(poses[b], poses[moved])), covariance)
    claims = Claims(poses[a], by_step @ poses[b], T, of_T, wander[a], wander_b)
    return mahalanobis_squared(se3.log(claims.frames), claims.frame_covariance)
