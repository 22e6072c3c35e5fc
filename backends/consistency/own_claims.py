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
from wiclosure.backends.least_squares.settling import outlier_limit
from wiclosure.types import BoolArray, FloatArray, IntArray

NEIGHBOURS = 8  # loops whose ends are nearest along the path, with which each is compared
PAIRS_AT_ONCE = 4096  # bounds memory
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
        drift, of_frames = self.drift, se3.adjoint(se3.inverse(self.frames))
        before, between = drift[self.first], drift[self.second] - drift[self.first]
        covariance = self.noise + between + se3.rotate_covariance(of_frames - np.eye(DEGREES), before)
        return mahalanobis_squared(se3.log(self.frames), covariance)

    @cached_property
    def noise(self) -> FloatArray:
        """Covariance `(N, 6, 6)` of `frames` by the measurements alone, as errors in the robot's frame."""
        return se3.rotate_covariance(se3.adjoint(self.robots.poses[self.second]), self.covariance)

    @cached_property
    def drift(self) -> FloatArray:
        """Covariances `(K, 6, 6)` of all poses by odometry, as errors in the robots' frames."""
        steps, of_steps = self.robots.odometry, np.zeros((len(self.robots.robot), DEGREES, DEGREES))
        moved = se3.adjoint(self.robots.poses[steps.second])
        of_steps[steps.second] = se3.rotate_covariance(moved, steps.covariance)
        summed = np.cumsum(of_steps, axis=0)
        return np.asarray(summed - summed[self.robots.first_nodes[self.robots.robot]])

    def pair_distances(self, one: IntArray, other: IntArray) -> FloatArray:
        """Squared Mahalanobis distances `(P,)` between the frames at `one` and those at `other`, of one robot each."""
        parts = range(0, len(one), PAIRS_AT_ONCE)
        of_parts = [self._apart(one[at : at + PAIRS_AT_ONCE], other[at : at + PAIRS_AT_ONCE]) for at in parts]
        return np.concatenate([np.zeros(0), *of_parts])

    def _apart(self, one: IntArray, other: IntArray) -> FloatArray:
        """Steps of odometry up to the first of the four ends move all of them, those up to the second three, ..."""
        ends = np.stack([self.first[one], self.second[one], self.first[other], self.second[other]], axis=1)
        moves = np.tile(np.eye(DEGREES), (*ends.shape, 1, 1))  # of the difference, by each end
        moves[:, 0], moves[:, 2] = (se3.adjoint(se3.inverse(self.frames[rows])) for rows in (one, other))
        moves[:, [0, 3]] *= -1.0
        order = np.argsort(ends, axis=1)
        ends, moves = np.take_along_axis(ends, order, 1), np.take_along_axis(moves, order[..., None, None], 1)
        moves = np.cumsum(moves[:, ::-1], axis=1)[:, ::-1]
        steps = np.diff(self.drift[ends], axis=1, prepend=0.0)
        covariance = self.noise[one] + self.noise[other] + se3.rotate_covariance(moves, steps).sum(axis=1)
        error = se3.log(se3.between(self.frames[one], self.frames[other]))
        return mahalanobis_squared(error, covariance)

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
        pairs, place = np.unique(np.minimum(one, other) * count + np.maximum(one, other), return_inverse=True)
        return one, other, self.pair_distances(pairs // count, pairs % count)[place]  # most are neighbours both ways

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
