"""Constant errors of odometry that closures tell of, by score tests of the estimate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.stats import chi2

from wiclosure import se3
from wiclosure.backends.consistency.merging import MergedGroups
from wiclosure.backends.least_squares.edges import DEGREES
from wiclosure.backends.least_squares.normal_matrix import Factorised
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.backends.least_squares.system import IN_PLANE, System
from wiclosure.backends.least_squares.team_arrays import TeamArrays
from wiclosure.backends.sets.candidate_sets import EXPECTED_BY_CHANCE
from wiclosure.types import FloatArray, IntArray, Trajectory

MOST_TAKEN = 60  # at once, of those that lower the cost most
ROUNDING = 1e-9  # share of what an error does to odometry, below which the poses undo all of it


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
    scores = tested.scores()
    telling = np.sort(np.argsort(-scores)[:MOST_TAKEN])
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
        jacobians: by both ends, at the estimate.
        residuals: `(M, D)` whitened.
        normal: equations of the poses.
        columns: `(C, 2)` robot and component of each constant error.
        moves: by robot, rows of its odometry `(K,)` and what a constant error moves these measurements by `(K, 6, 6)`.
    """

    system: System
    jacobians: tuple[FloatArray, FloatArray]
    residuals: FloatArray
    normal: Factorised
    columns: IntArray
    moves: Mapping[int, tuple[IntArray, FloatArray]]

    @classmethod
    def of(
        cls, team: TeamArrays, restated: Robots, merged: MergedGroups, trajectories: Mapping[str, Trajectory]
    ) -> _Tested:
        robots, poses = restated, merged.settled.poses
        held = np.array([robots.first_nodes[np.flatnonzero(merged.group == g)[0]] for g in np.unique(merged.group)])
        edges = robots.odometry + robots.loops.subset(merged.inlier)
        system = System.of(edges, poses, held)
        J, residuals = system.jacobians(poses), system.residuals(poses)
        normal = system.normal.factorised(*J, np.ones(len(edges)), held, 0.0)
        moves = {}
        for number, name in enumerate(team.names):
            rows = np.flatnonzero(robots.robot[robots.odometry.first] == number)
            if len(rows) and trajectories[name].parents is None:  # odometry that branches is no one path
                moves[number] = rows, _moves(trajectories[name], team.nodes[name])
        free = system.free if robots.degrees == DEGREES else IN_PLANE
        columns = np.array([(robot, component) for robot in moves for component in free.tolist()], np.int64)
        return cls(system, J, residuals, normal, columns.reshape(-1, 2), moves)

    def scores(self) -> FloatArray:
        """By how much each alone would lower the cost, `(C,)`."""
        scores = np.zeros(len(self.columns))
        for robot in self.moves:
            of_robot = np.flatnonzero(self.columns[:, 0] == robot)
            G, g = self._equations(of_robot)
            scores[of_robot] = g**2 / np.diagonal(G)
        return scores

    def chosen(self, columns: IntArray, limit: float) -> dict[int, float]:
        """Values of those that lower the cost by more than the limit each, the best first; that of the others is 0."""
        (G, g), inside = self._equations(columns), np.zeros(0, np.int64)
        values: FloatArray = np.zeros(0)
        while len(inside) < len(columns):
            rest = np.setdiff1d(np.arange(len(columns)), inside)
            explained = np.linalg.solve(G[np.ix_(inside, inside)], G[np.ix_(inside, rest)])
            left = g[rest] - G[np.ix_(rest, inside)] @ values
            own = np.diagonal(G)[rest] - np.einsum("ir,ir->r", G[np.ix_(inside, rest)], explained)
            gained = left**2 / np.maximum(own, ROUNDING * np.diagonal(G)[rest])
            if gained.max() <= limit:
                break
            inside = np.append(inside, rest[np.argmax(gained)])
            values = np.asarray(np.linalg.solve(G[np.ix_(inside, inside)], g[inside]))
        return dict(zip(columns[inside].tolist(), values.tolist(), strict=True))

    def _equations(self, columns: IntArray) -> tuple[FloatArray, FloatArray]:
        """Normal equations `(K, K)` and `(K,)` of constant errors `(K,)`, where the poses give way.

        With A what they do to the whitened residuals r, and J what the poses do: `A^T A - Y^T Y` and `A^T r - Y^T y`,
        where `L L^T = J^T J`, `L Y = J^T A` and `L y = J^T r`.
        """
        robots = {robot: self.moves[robot] for robot in np.unique(self.columns[columns, 0]).tolist()}
        rows = np.concatenate([of for of, _ in robots.values()])
        starts = dict(zip(robots, np.cumsum([0, *(len(of) for of, _ in robots.values())]).tolist(), strict=False))
        A = np.zeros((len(rows), len(self.system.compared), len(columns)))
        for k, (robot, component) in enumerate(self.columns[columns].tolist()):
            of, moves = robots[robot]
            part = slice(starts[robot], starts[robot] + len(of))
            A[part, :, k] = (self.system.W[of] @ moves[:, self.system.compared, component, None])[..., 0]
        reached, Y = self._half_solved(rows, A)
        of_all = A.reshape(-1, len(columns))
        G, g = of_all.T @ of_all, of_all.T @ self.residuals[rows].ravel() - Y.T @ self._half_of_residuals[reached]
        least = ROUNDING * np.diagonal(G)  # of an error that the poses undo, nothing is known
        G -= Y.T @ Y
        np.fill_diagonal(G, np.maximum(np.diagonal(G), least))
        return G, g

    @cached_property
    def _half_of_residuals(self) -> FloatArray:
        """y, of all unknowns."""
        y = np.zeros(self.system.size * len(self.system.free))
        reached, part = self._half_solved(np.arange(len(self.residuals)), self.residuals[..., None])
        y[reached] = part[:, 0]
        return y

    def _half_solved(self, rows: IntArray, of_edges: FloatArray) -> tuple[IntArray, FloatArray]:
        """`L^-1 J^T A` of what stands at the edges `rows`, `A (R, D, K)`: `Factorised.half_solved`."""
        edges = self.system.edges
        nodes, place = np.unique(np.concatenate([edges.first[rows], edges.second[rows]]), return_inverse=True)
        right = np.concatenate([np.swapaxes(J[rows], 1, 2) @ of_edges for J in self.jacobians])
        gradient = np.zeros((len(nodes), *right.shape[1:]))
        np.add.at(gradient, place, right)
        return self.normal.half_solved(nodes, gradient)


def _moves(trajectory: Trajectory, nodes: IntArray) -> FloatArray:
    """What an error of one unit in each metre moves the odometry between nodes `(K + 1,)` by, `(K, 6, 6)`."""
    T = se3.between(trajectory.poses[0], trajectory.poses)
    sums = np.zeros((len(T), DEGREES, DEGREES))
    np.cumsum(se3.adjoint(T[1:]) * np.diff(trajectory.distance)[:, None, None], axis=0, out=sums[1:])
    return se3.adjoint(se3.inverse(T[nodes[1:]])) @ np.diff(sums[nodes], axis=0)
