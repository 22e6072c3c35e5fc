"""The consistency check as closures arrive: all are decided on now and then, and new ones by what that predicts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wiclosure import se3
from wiclosure.backends.closure_sets import ClosureSet, closure_sets
from wiclosure.backends.config import PcmSettings
from wiclosure.backends.consistency.merging import MergedGroups
from wiclosure.backends.consistency.pcm import PcmResult, pairwise_consistent
from wiclosure.backends.least_squares.edges import mahalanobis_squared
from wiclosure.backends.least_squares.settling import outlier_limit
from wiclosure.backends.least_squares.team_arrays import TeamArrays, covariance_parts_between
from wiclosure.backends.least_squares.variance_components import summed
from wiclosure.types import BoolArray, Closure, FloatArray, IntArray, Trajectory

GROWTH = 0.025  # of the number of closures, after which all are decided on again: the work is that of a few decisions


class IncrementalConsistency:
    """Which closures are inliers, at any time; `result` is the answer over all of them at once."""

    def __init__(self, settings: PcmSettings) -> None:
        self.settings = settings
        self._closures: list[Closure] = []
        self._odometry: Mapping[str, Trajectory] = {}
        self._inliers: set[int] = set()
        self._decided = 0
        self._result: PcmResult | None = None
        self._basis: tuple[TeamArrays, MergedGroups] | None = None

    def add(self, closures: Sequence[Closure], trajectories: Mapping[str, Trajectory]) -> None:
        """Takes more closures in.

        Args:
            closures: those that are new.
            trajectories: keyframe odometry of all robots; may have grown, but is otherwise that of all calls before.

        Raises:
            InputError: a closure names a robot or a keyframe that the trajectories do not have.
        """
        sets, _ = closure_sets(closures, trajectories, self.settings.noise)
        first = len(self._closures)
        self._closures += closures
        self._odometry, self._result = trajectories, None
        new = [replace(closure_set, rows=closure_set.rows + first) for closure_set in sets]
        if not self.settings.enabled:
            self._inliers |= {row for closure_set in new for row in closure_set.rows.tolist()}
        elif self.settings.published or len(self._closures) - self._decided >= max(1.0, GROWTH * len(self._closures)):
            self.result()
        else:
            self._inliers |= {
                row for closure_set in new for row in closure_set.rows[self._predicted(closure_set)].tolist()
            }

    @property
    def inlier_rows(self) -> frozenset[int]:
        """Positions of the inliers among all closures that were added; of all usable ones without a check."""
        return frozenset(self._inliers)

    def result(self) -> PcmResult:
        """All closures with their decisions, taken anew where closures or odometry came since the last time."""
        if self._result is None:
            self._result = pairwise_consistent(self._closures, self._odometry, self.settings)
            self._decided = len(self._closures)
            self._basis = self._result.basis
            unusable = closure_sets(self._closures, self._odometry, self.settings.noise)[1]
            live = (row for row, closure in enumerate(self._result.closures) if closure.live)
            self._inliers = set(live) - unusable.keys()
        return self._result

    def _predicted(self, closure_set: ClosureSet) -> BoolArray:
        """Which closures `(N,)` lie where the last decision and odometry since predict them."""
        nothing = np.zeros(len(closure_set), bool)
        if self._basis is None:
            return nothing
        team, merged = self._basis
        a, b = (team.names.index(robot) for robot in (closure_set.robot_a, closure_set.robot_b))
        if merged.group[a] != merged.group[b]:
            return nothing
        T_a, wander_a, since_a = self._at(closure_set.robot_a, closure_set.index_a)
        T_b, wander_b, since_b = self._at(closure_set.robot_b, closure_set.index_b)
        predicted = se3.between(T_a, T_b)
        apart = se3.adjoint(se3.inverse(T_b)) @ (wander_b - wander_a)
        spread = apart @ np.swapaxes(apart, 1, 2) / apart.shape[2]
        odometry = since_b + se3.rotate_covariance(se3.adjoint(se3.inverse(predicted)), since_a)
        covariance = spread + odometry + summed(closure_set.covariance_parts(), merged.factors)
        distance = mahalanobis_squared(se3.log(se3.between(closure_set.T_a_b, predicted)), covariance)
        return np.asarray(
            distance <= outlier_limit(len(self._closures), self.settings.probability, team.robots.degrees)
        )

    def _at(self, robot: str, indices: IntArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Estimated poses, samples of their errors, and covariances of the odometry since the node before."""
        assert self._basis is not None
        team, merged = self._basis
        number = team.names.index(robot)
        nodes, trajectory, factor = team.nodes[robot], self._odometry[robot], merged.odometry_factors[number]
        if factor != 1.0:  # else what it knows of its drift stays known
            trajectory = trajectory.loosened(factor)
        before = np.searchsorted(nodes, indices, side="right") - 1
        node = team.robots.first_nodes[number] + before
        T = merged.settled.poses[node] @ trajectory.relative_pose(nodes[before], indices)
        since = summed(covariance_parts_between(trajectory, nodes[before], indices), merged.factors)
        return T, merged.settled.wander[node], since
