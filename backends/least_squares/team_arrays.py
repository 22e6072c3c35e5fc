"""Trajectories and closures as the arrays that the estimate works on: keyframes in factors are nodes, numbered."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.backends.closure_sets import ClosureSet, canonical_order, covariance_parts
from wiclosure.backends.factor_graph.factors import keyframes_in_factors, odometry_covariances
from wiclosure.backends.least_squares.edges import Edges
from wiclosure.backends.least_squares.robots import Robots
from wiclosure.types import BoolArray, FloatArray, IntArray, Trajectory


@dataclass(frozen=True, eq=False)
class TeamArrays:
    """A team whose nodes are the keyframes that closures hold, the first of each robot among them.

    Args:
        robots: the arrays.
        names: robot names in the order of the arrays: by how the robots started, so that names and order of robots
            change nothing.
        nodes: keyframe indices `(K,)` by robot.
        rows: `(M,)` row of each closure in the list that the sets came from.
    """

    robots: Robots
    names: tuple[str, ...]
    nodes: Mapping[str, IntArray]
    rows: IntArray

    @classmethod
    def of(
        cls,
        trajectories: Mapping[str, Trajectory],
        sets: Sequence[ClosureSet],
        predicted: BoolArray,
        nodes: Mapping[str, IntArray] | None = None,
    ) -> TeamArrays:
        """Of the closures in `sets`; `predicted` by row of the list that they came from.

        The nodes may be more keyframes than closures hold.
        """
        names, held = canonical_order(trajectories), keyframes_in_factors(trajectories, sets)
        nodes = held if nodes is None else nodes
        offset = dict(zip(names, np.cumsum([0, *(len(nodes[name]) for name in names)]), strict=False))
        steps = [_steps(trajectories[name], nodes[name], held[name], int(offset[name])) for name in names]
        odometry = Edges.stacked(steps)
        of_steps = [_parts(trajectories[name], nodes[name], held[name]) for name in names]
        none = np.zeros((3, 0, 6, 6))
        of_loops = [none, *(closure_set.covariance_parts() for closure_set in sets)]
        parts = np.concatenate([none, *of_steps], axis=1), np.concatenate(of_loops, axis=1)
        loops = Edges.stacked(
            [
                Edges(
                    offset[closure_set.robot_a] + np.searchsorted(nodes[closure_set.robot_a], closure_set.index_a),
                    offset[closure_set.robot_b] + np.searchsorted(nodes[closure_set.robot_b], closure_set.index_b),
                    closure_set.T_a_b,
                    closure_set.covariance,
                )
                for closure_set in sets
            ]
        )
        rows = np.concatenate([np.zeros(0, np.int64), *(closure_set.rows for closure_set in sets)])
        robot = np.repeat(np.arange(len(names)), [len(nodes[name]) for name in names])
        # Each robot from its first pose: far from the origin, as UTM coordinates are, digits would be lost.
        local = [se3.between(trajectories[name].poses[0], trajectories[name].poses[nodes[name]]) for name in names]
        step_m = float(np.median(np.concatenate([np.zeros(1), *(np.diff(t.distance) for t in trajectories.values())])))
        along_m = np.concatenate([trajectories[name].distance[nodes[name]] for name in names])
        length_m = np.array([np.ptp(trajectories[name].distance) for name in names])
        robots = Robots(
            robot, np.concatenate(local), odometry, loops, predicted[rows], along_m, length_m, step_m, parts
        )
        return cls(robots, tuple(names), nodes, rows)

    def poses_of(self, poses: FloatArray) -> dict[str, FloatArray]:
        """The node poses `(N, 4, 4)` by robot."""
        return dict(zip(self.names, np.split(poses, self.robots.first_nodes[1:]), strict=True))

    def stacked(self, poses: Mapping[str, FloatArray]) -> FloatArray:
        """`(N, 4, 4)` of all keyframes' poses by robot."""
        return np.concatenate([poses[name][self.nodes[name]] for name in self.names])


def covariance_parts_between(trajectory: Trajectory, first: IntArray, second: IntArray) -> FloatArray:
    """`(3, M, 6, 6)` of the covariances of `relative_pose(first, second)`, what comes of the parts of each step's."""
    if trajectory.step_covariances is None:
        return covariance_parts(trajectory.relative_covariance(first, second))
    of_each = (replace(trajectory, step_covariances=part) for part in covariance_parts(trajectory.step_covariances))
    return np.stack([of_part.relative_covariance(first, second) for of_part in of_each])


def _parts(trajectory: Trajectory, nodes: IntArray, held: IntArray) -> FloatArray:
    """`(3, K - 1, 6, 6)` of the covariances of the steps between nodes."""
    if trajectory.step_covariances is None:
        return covariance_parts(odometry_covariances(trajectory, nodes, held))
    return covariance_parts_between(trajectory, *trajectory.steps(nodes))


def _steps(trajectory: Trajectory, nodes: IntArray, held: IntArray, offset: int) -> Edges:
    first, second = trajectory.steps(nodes)
    T, covariance = trajectory.relative_pose(first, second), odometry_covariances(trajectory, nodes, held)
    return Edges(offset + np.searchsorted(nodes, first), offset + np.searchsorted(nodes, second), T, covariance)
