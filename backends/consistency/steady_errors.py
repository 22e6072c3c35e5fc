"""Constant errors of odometry that closures tell of, by score tests of the estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.consistency.merging import MergedGroups
from wiclosure.backends.least_squares.edges import DEGREES
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.system import IN_PLANE, System
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.backends.sets.candidate_sets import EXPECTED_BY_CHANCE
from wiclosure.types import FloatArray, IntArray, Trajectory

COLUMNS_AT_ONCE = 60  # bounds memory


def steady_errors(
    team: TeamArrays, restated: Robots, merged: MergedGroups, trajectories: Mapping[str, Trajectory]
) -> dict[str, FloatArray]:
    """Tangent vectors `(6,)`, rad and m per metre, by robot: those without which the estimate would cost much less.

    One component of one robot after another, as long as one lowers the cost by more than chance makes of the best of
    all once in 200 graphs.

    Args:
        team: the arrays.
        restated: its robots with standard deviations as they are taken.
        merged: the estimate and its inliers.
        trajectories: odometry that the arrays come from.
    """
    tested = _Tested.of(team, restated, merged, trajectories)
    count = len(tested.columns)
    if not count:
        return {}
    limit = float(chi2.isf(EXPECTED_BY_CHANCE / count, 1))
    parts = [np.arange(count)[n : n + COLUMNS_AT_ONCE] for n in range(0, count, COLUMNS_AT_ONCE)]
    scores = np.concatenate([tested.scores(part) for part in parts])
    telling = np.sort(np.argsort(-scores)[:COLUMNS_AT_ONCE])
    telling, found = telling[scores[telling] > limit], dict[str, FloatArray]()
    for column, value in (tested.chosen(telling, limit) if len(telling) else {}).items():
        robot, component = tested.columns[column]
        found.setdefault(team.names[robot], np.zeros(DEGREES))[component] = value
    return found


@dataclass(frozen=True, eq=False)
class _Tested:
    """An estimate, linearised, and what constant errors would do to its residuals.

    Args:
        system: odometry, and the inliers.
        poses: of the estimate.
        held: nodes.
        columns: `(C, 2)` robot and component of each constant error.
        moves: by robot, rows of its odometry `(K,)` and what a constant error moves these measurements by `(K, 6, 6)`.
    """

    system: System
    poses: FloatArray
    held: IntArray
    columns: IntArray
    moves: Mapping[int, tuple[IntArray, FloatArray]]

    @classmethod
    def of(
        cls, team: TeamArrays, restated: Robots, merged: MergedGroups, trajectories: Mapping[str, Trajectory]
    ) -> _Tested:
        robots, poses = restated, merged.settled.poses
        held = np.array([robots.first_nodes[np.flatnonzero(merged.group == g)[0]] for g in np.unique(merged.group)])
        system = System.of(robots.odometry + robots.loops.subset(merged.inlier), poses, held)
        moves = {}
        for number, name in enumerate(team.names):
            rows = np.flatnonzero(robots.robot[robots.odometry.first] == number)
            if len(rows) and trajectories[name].parents is None:  # odometry that branches is no one path
                moves[number] = rows, _moves(trajectories[name], team.nodes[name])
        free = system.free if robots.degrees == DEGREES else IN_PLANE
        columns = np.array([(robot, component) for robot in moves for component in free.tolist()], np.int64)
        return cls(system, poses, held, columns.reshape(-1, 2), moves)

    def scores(self, columns: IntArray) -> FloatArray:
        """By how much each alone would lower the cost, `(K,)`."""
        A, residuals = self._projected(columns)
        return np.asarray((A.T @ residuals) ** 2 / np.maximum(np.sum(A**2, axis=0), 1e-12))

    def chosen(self, columns: IntArray, limit: float) -> dict[int, float]:
        """Values of those that lower the cost by more than the limit each, the best first; that of the others is 0."""
        A, residuals = self._projected(columns)
        G, g, inside = A.T @ A, A.T @ residuals, np.zeros(0, np.int64)
        values: FloatArray = np.zeros(0)
        while len(inside) < len(columns):
            rest = np.setdiff1d(np.arange(len(columns)), inside)
            explained = np.linalg.solve(G[np.ix_(inside, inside)], G[np.ix_(inside, rest)])
            left = g[rest] - G[np.ix_(rest, inside)] @ values
            own = np.diagonal(G)[rest] - np.einsum("ir,ir->r", G[np.ix_(inside, rest)], explained)
            gained = left**2 / np.maximum(own, 1e-9 * np.diagonal(G)[rest])
            if gained.max() <= limit:
                break
            inside = np.append(inside, rest[np.argmax(gained)])
            values = np.asarray(np.linalg.solve(G[np.ix_(inside, inside)], g[inside]))
        return dict(zip(columns[inside].tolist(), values.tolist(), strict=True))

    def _projected(self, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """What constant errors `(K,)` do to all whitened residuals, `(M D, K)`, where the poses give way; and these."""
        system = self.system.starting(self.poses)
        J, height = system.jacobians(self.poses), len(system.compared)
        A = np.zeros((len(system.edges), height, len(columns)))
        for k, (robot, component) in enumerate(self.columns[columns].tolist()):
            rows, moves = self.moves[robot]
            A[rows, :, k] = (system.W[rows] @ moves[:, system.compared, component, None])[..., 0]
        factorised = system.normal.factorised(*J, np.ones(len(system.edges)), self.held, 0.0)
        moved = factorised.solve(-system.gradient(J, A))
        A += J[0] @ moved[system.edges.first] + J[1] @ moved[system.edges.second]
        return A.reshape(-1, len(columns)), system.residuals(self.poses).ravel()


def _moves(trajectory: Trajectory, nodes: IntArray) -> FloatArray:
    """What an error of one unit in each metre moves the odometry between nodes `(K + 1,)` by, `(K, 6, 6)`."""
    T = se3.between(trajectory.poses[0], trajectory.poses)
    sums = np.zeros((len(T), DEGREES, DEGREES))
    np.cumsum(se3.adjoint(T[1:]) * np.diff(trajectory.distance)[:, None, None], axis=0, out=sums[1:])
    return se3.adjoint(se3.inverse(T[nodes[1:]])) @ np.diff(sums[nodes], axis=0)
