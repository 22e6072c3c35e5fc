"""What odometry and neighbouring loops say of a robot's own loops before anything is estimated.

A loop within a robot claims where the robot's frame lies in itself.  Odometry may refute that; but where neighbours
along both ends of the path claim the same, as those of a true loop do whatever odometry lost in between, they tell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import cKDTree

from wiclosure import se3
from wiclosure.backends.least_squares.edges import DEGREES, mahalanobis_squared
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.settling import SAMPLES, outlier_limit
from wiclosure.backends.least_squares.system import LEAST_VARIANCE
from wiclosure.backends.sets.claims import Claims
from wiclosure.types import BoolArray, FloatArray, IntArray

NEIGHBOURS = 8  # loops whose ends are nearest along the path, with which each is compared
SUPPORTERS = 2  # of them, supported themselves, that must agree with it: one may by chance


@dataclass(frozen=True, eq=False)
class OwnClaims:
    """Loops within robots `(N,)`, each from its earlier end to the later.

    Args:
        claims: `T_A_B` of a robot in itself: the identity as odometry has it.
        robot: `(N,)` of each.
        along_m: `(N, 2)` way from the robot's first keyframe to both ends.
    """

    claims: Claims
    robot: IntArray
    along_m: FloatArray

    @classmethod
    def of(cls, robots: Robots) -> OwnClaims:
        """Of the rows at `robots.own`, in their order."""
        loops, wander = robots.loops.subset(robots.own), _wander(robots)
        turned = loops.first > loops.second
        T, covariance = loops.T.copy(), loops.covariance.copy()
        covariance[turned] = se3.inverse_covariance(T[turned], covariance[turned])
        T[turned] = se3.inverse(T[turned])
        a, b = np.minimum(loops.first, loops.second), np.maximum(loops.first, loops.second)
        claims = Claims(robots.poses[a], robots.poses[b], T, covariance, wander[a], wander[b])
        return cls(claims, robots.robot[a], np.stack([robots.along_m[a], robots.along_m[b]], axis=1))

    @cached_property
    def distances(self) -> FloatArray:
        """`(N,)` squared Mahalanobis distances from what odometry says."""
        return mahalanobis_squared(se3.log(self.claims.frames), self.claims.frame_covariance)

    def refuted(self, limit: float) -> BoolArray:
        """`(N,)` those further from what odometry says than a squared distance of `limit`."""
        return self.distances > limit

    def contradictory(self, limit: float, probability: float, degrees: int) -> bool:
        """Whether odometry refutes one of them, as `refuted`, or two neighbours where both are to be true.

        Args:
            limit: squared distance from what odometry says.
            probability: that no two true neighbours contradict each other.
            degrees: of freedom.
        """
        apart = self.neighbours[2]
        return bool(self.refuted(limit).any() or (apart > outlier_limit(len(apart), probability, degrees)).any())

    @cached_property
    def neighbours(self) -> tuple[IntArray, IntArray, FloatArray]:
        """Pairs `(P,)`, `(P,)` of one robot, each loop with those nearest to it, and their squared distances."""
        count = len(self.claims)
        apart_m = 2.0 * self.along_m.max(initial=0.0) * self.robot  # robots are no neighbours
        places = np.column_stack([self.along_m, apart_m])
        _, nearest = cKDTree(places).query(places, k=min(NEIGHBOURS + 1, count))
        one, other = np.repeat(np.arange(count), nearest.size // max(count, 1)), nearest.ravel()
        comparable = (one != other) & (self.robot[one] == self.robot[other])
        one, other = one[comparable], other[comparable]
        return one, other, self.claims.pair_distances(one, other)

    def supported(self, limit: float) -> BoolArray:
        """`(N,)` those that neighbours, supported like them, lie within a squared distance of `limit` of."""
        count, (one, other, apart) = len(self.claims), self.neighbours
        agree = apart <= limit
        one, other, found = one[agree], other[agree], np.ones(count, bool)
        while True:
            still = np.bincount(one[found[other]], minlength=count) >= SUPPORTERS
            if (still == found).all():
                return found
            found = still


def _wander(robots: Robots) -> FloatArray:
    """Samples `(N, 6, S)` of the errors of the poses by odometry, as tangent vectors in the robots' frames."""
    steps, rng = robots.odometry, np.random.default_rng(len(robots.odometry))
    L = np.linalg.cholesky(steps.covariance + LEAST_VARIANCE * np.eye(DEGREES))
    errors = np.zeros((len(robots.robot), DEGREES, SAMPLES))
    errors[steps.second] = se3.adjoint(robots.poses[steps.second]) @ L @ rng.normal(size=(len(steps), DEGREES, SAMPLES))
    summed = np.cumsum(errors, axis=0)
    return np.asarray(summed - summed[robots.first_nodes[robots.robot]])
