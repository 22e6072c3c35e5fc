"""A team of robots as arrays: nodes, odometry and closures."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wiclosure.backends.least_squares.edges import Edges, degrees_of_true_ones
from wiclosure.backends.least_squares.variance_components import restated, restated_parts, summed
from wiclosure.types import BoolArray, FloatArray, IntArray

WRITTEN = 1e-6  # rad, m: one sigma of what six decimals leave of a quaternion or a coordinate
WRITTEN_SHARE = 3e-6  # of a length, what six significant digits leave of it


@dataclass(frozen=True, eq=False)
class Robots:
    """A team as arrays.

    Args:
        robot: `(N,)` robot of each node, numbered; nodes of one robot follow each other.
        poses: `(N, 4, 4)` by odometry, each robot in its own frame.
        odometry: edges between consecutive nodes.
        loops: all closures `(M,)`.
        predicted: `(M,)` closures that a prediction supports.
        along_m: `(N,)` way from the robot's first keyframe to each node, by odometry.
        length_m: `(R,)` of each robot's path, which may go on beyond its last node.
        step_m: median distance between keyframes; nodes may be further apart.
        parts: covariances of odometry and of loops by what is stated of rotation, of both, and of translation
            (`covariance_parts`); None where only their sums are known.
    """

    robot: IntArray
    poses: FloatArray
    odometry: Edges
    loops: Edges
    predicted: BoolArray
    along_m: FloatArray
    length_m: FloatArray
    step_m: float
    parts: tuple[FloatArray, FloatArray] | None = None

    @property
    def count(self) -> int:
        """Of robots."""
        return int(self.robot[-1]) + 1

    @cached_property
    def degrees(self) -> int:
        """Of freedom of true measurements."""
        return degrees_of_true_ones(self.odometry.T, self.loops.T)

    @property
    def own(self) -> BoolArray:
        """Closures `(M,)` within one robot."""
        return np.asarray(self.robot[self.loops.first] == self.robot[self.loops.second])

    @property
    def loop_ends(self) -> IntArray:
        """Nodes `(2, M)` of all closures."""
        return np.stack([self.loops.first, self.loops.second])

    def groups_of_ends(self, group: IntArray) -> tuple[IntArray, IntArray]:
        """Group of both ends of each closure, by the group `(R,)` of each robot."""
        return group[self.robot[self.loops.first]], group[self.robot[self.loops.second]]

    @cached_property
    def first_nodes(self) -> IntArray:
        """Of each robot."""
        return np.flatnonzero(np.r_[True, self.robot[1:] != self.robot[:-1]])

    def nodes_of(self, robots: IntArray) -> IntArray:
        """Nodes of some robots, one robot's after the other's."""
        ends = np.append(self.first_nodes[1:], len(self.robot))
        ranges = [np.arange(self.first_nodes[robot], ends[robot]) for robot in robots.tolist()]
        return np.concatenate([np.zeros(0, np.int64), *ranges])

    def drift_share(self) -> float:
        """How far the odometry of a path may drift, one sigma of its steps' translations, by the path's extent.

        The median of the robots that close loops of their own; 0 without any.
        """
        of_step = np.trace(self.odometry.covariance[:, 3:, 3:], axis1=1, axis2=2) / 3.0
        drift_m = np.sqrt(np.bincount(self.robot[self.odometry.first], of_step, self.count))
        paths = np.split(self.poses[:, :3, 3], self.first_nodes[1:])
        extent_m = np.array([np.linalg.norm(np.ptp(path, axis=0)) for path in paths])
        closing = np.unique(self.robot[self.loops.first[self.own]])
        shares = drift_m[closing] / np.maximum(extent_m[closing], 1e-9)
        return float(np.median(shares)) if len(closing) else 0.0

    def alone(self, robot: int) -> Robots:
        """One of them, with its own loops."""
        nodes = np.flatnonzero(self.robot == robot)
        own, first = self.own & (self.robot[self.loops.first] == robot), nodes[0]
        odometry, loops = (
            Edges(e.first - first, e.second - first, e.T, e.covariance)
            for e in (self.odometry.subset(self.robot[self.odometry.first] == robot), self.loops.subset(own))
        )
        return Robots(
            np.zeros(len(nodes), np.int64), self.poses[nodes], odometry, loops, self.predicted[own],
            self.along_m[nodes], self.length_m[[robot]], self.step_m,
        )  # fmt: skip

    def cut(self, node: int) -> Robots:
        """The robot of a node as two: from this node on, it is one more; the steps of odometry between are left out."""
        robot, crossing = int(self.robot[node]), self.steps_across(node)
        start_m, end_m = self.along_m[self.first_nodes[robot]], self.along_m[node - 1]
        lengths_m = [end_m - start_m, self.length_m[robot] - (self.along_m[node] - start_m)]
        return replace(
            self,
            robot=self.robot + (np.arange(len(self.robot)) >= node),
            odometry=self.odometry.subset(~crossing),
            length_m=np.concatenate([self.length_m[:robot], lengths_m, self.length_m[robot + 1 :]]),
            parts=None if self.parts is None else (self.parts[0][:, ~crossing], self.parts[1]),
        )

    def steps_across(self, node: int) -> BoolArray:
        """Steps of odometry, of all, from a node before this to it or to one behind."""
        return np.asarray((self.odometry.first < node) & (self.odometry.second >= node))

    def loosened(self, factors: FloatArray) -> Robots:
        """The standard deviations of each robot's odometry times factors `(R,)`."""
        squared = factors[self.robot[self.odometry.first]][:, None, None] ** 2
        parts = None if self.parts is None else (squared * self.parts[0], self.parts[1])
        return replace(
            self, odometry=replace(self.odometry, covariance=squared * self.odometry.covariance), parts=parts
        )

    def scaled(self, factors: float | FloatArray) -> Robots:
        """All standard deviations times one factor, or `(2,)` of rotation and translation.

        Smaller ones leave in what numbers lose where they are written: measurements without noise have that left.
        """
        if self.parts is None or not np.ndim(factors):  # one factor: with what was left in before
            of_edges = [restated(edges.covariance, factors) for edges in (self.odometry, self.loops)]
        else:
            of_edges = [summed(of, factors) for of in self.parts]
        odometry, loops = (
            _written(edges, covariance, factors)
            for edges, covariance in zip((self.odometry, self.loops), of_edges, strict=True)
        )
        parts = None
        if self.parts is not None:
            parts = restated_parts(self.parts[0], factors), restated_parts(self.parts[1], factors)
        return replace(self, odometry=odometry, loops=loops, parts=parts)


def _written(edges: Edges, covariance: FloatArray, factors: float | FloatArray) -> Edges:
    if np.min(factors) < 1.0:
        axes, length = np.arange(6), np.linalg.norm(edges.T[:, :3, 3], axis=1, keepdims=True)
        covariance[:, axes, axes] += WRITTEN**2
        covariance[:, axes[3:], axes[3:]] += (WRITTEN_SHARE * length) ** 2
    return Edges(edges.first, edges.second, edges.T, covariance)
