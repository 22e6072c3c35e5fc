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
        robots: the team.
        first, second: `(N,)` nodes of the ends.
        T: `(N, 4, 4)` the measurements.
        covariance: `(N, 6, 6)` of them.
    """

    robots: Robots
    first: IntArray
    second: IntArray
    T: FloatArray
    covariance: FloatArray

    @classmethod
    def of(cls, robots: Robots) -> OwnClaims:
        """Of the rows at `robots.own`, in their order."""
        loops = robots.loops.subset(robots.own)
        turned = loops.first > loops.second
        loops.covariance[turned] = se3.inverse_covariance(loops.T[turned], loops.covariance[turned])
        loops.T[turned] = se3.inverse(loops.T[turned])
        first, second = np.minimum(loops.first, loops.second), np.maximum(loops.first, loops.second)
        return cls(robots, first, second, loops.T, loops.covariance)

    def __len__(self) -> int:
        return len(self.first)

    @property
    def robot(self) -> IntArray:
        """`(N,)` of each."""
        return self.robots.robot[self.first]

    @cached_property
    def frames(self) -> FloatArray:
        """`T_A_B (N, 4, 4)` of a robot in itself as each loop has it; the identity as odometry has it."""
        poses = self.robots.poses
        return np.asarray(poses[self.first] @ self.T @ se3.inverse(poses[self.second]))

    @cached_property
    def distances(self) -> FloatArray:
        """`(N,)` squared Mahalanobis distances from what odometry says.

        Errors of odometry up to the earlier end move both ends; those of the steps between, the later one alone.
        """
        summed, of_frames = _drift(self.robots), se3.adjoint(se3.inverse(self.frames))
        before, between = summed[self.first], summed[self.second] - summed[self.first]
        noise = se3.rotate_covariance(se3.adjoint(self.robots.poses[self.second]), self.covariance)
        covariance = noise + between + se3.rotate_covariance(of_frames - np.eye(DEGREES), before)
        return mahalanobis_squared(se3.log(self.frames), covariance)

    @cached_property
    def claims(self) -> Claims:
        """With samples of the errors of odometry, which loops share."""
        T_a, T_b = self.robots.poses[self.first], self.robots.poses[self.second]
        wander = _wander(self.robots)
        return Claims(T_a, T_b, self.T, self.covariance, wander[self.first], wander[self.second])

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
        count, robot = len(self), self.robot
        along_m = np.stack([self.robots.along_m[self.first], self.robots.along_m[self.second]], axis=1)
        places = np.column_stack([along_m, 2.0 * along_m.max(initial=0.0) * robot])  # robots are no neighbours
        _, nearest = cKDTree(places).query(places, k=min(NEIGHBOURS + 1, count))
        one, other = np.repeat(np.arange(count), nearest.size // max(count, 1)), nearest.ravel()
        comparable = (one != other) & (robot[one] == robot[other])
        one, other = one[comparable], other[comparable]
        return one, other, self.claims.pair_distances(one, other)

    def supported(self, limit: float) -> BoolArray:
        """`(N,)` those that neighbours, supported like them, lie within a squared distance of `limit` of."""
        count, (one, other, apart) = len(self), self.neighbours
        agree = apart <= limit
        one, other, found = one[agree], other[agree], np.ones(count, bool)
        while True:
            still = np.bincount(one[found[other]], minlength=count) >= SUPPORTERS
            if (still == found).all():
                return found
            found = still


def _drift(robots: Robots) -> FloatArray:
    """Covariances `(N, 6, 6)` of the poses by odometry, of errors in the robots' frames, since the first robot's."""
    steps = robots.odometry
    of_steps = np.zeros((len(robots.robot), DEGREES, DEGREES))
    of_steps[steps.second] = se3.rotate_covariance(se3.adjoint(robots.poses[steps.second]), steps.covariance)
    summed = np.cumsum(of_steps, axis=0)
    return np.asarray(summed - summed[robots.first_nodes[robots.robot]])


def _wander(robots: Robots) -> FloatArray:
    """Samples `(N, 6, S)` of the errors of the poses by odometry, as tangent vectors in the robots' frames."""
    steps, rng = robots.odometry, np.random.default_rng(len(robots.odometry))
    L = np.linalg.cholesky(steps.covariance + LEAST_VARIANCE * np.eye(DEGREES))
    errors = np.zeros((len(robots.robot), DEGREES, SAMPLES))
    errors[steps.second] = se3.adjoint(robots.poses[steps.second]) @ L @ rng.normal(size=(len(steps), DEGREES, SAMPLES))
    summed = np.cumsum(errors, axis=0)
    return np.asarray(summed - summed[robots.first_nodes[robots.robot]])
