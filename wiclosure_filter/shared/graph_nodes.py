"""A long trajectory as few graph nodes: where the radio was heard, at both ends, and every so many metres between.

A node is a frame with the axes of the robot's odometry frame and its origin at an antenna or a keyframe.  Hence
odometry between nodes is a pure translation, lever arms are dealt with, and bearings need no further turning.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.drift import AccumulatedDrift, DriftModel
from wiclosure.types import FloatArray, IntArray, Trajectory
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

# Nodes without a link, for each robot: of longer trajectories the nodes lie further apart.
MOST_NODES = 100

# Odometry between two antennas heard at one keyframe: never quite certain, so that no covariance is singular.
LEAST_SIGMA = 1e-3


@dataclass(frozen=True, slots=True)
class NodeSpacing:
    """How far nodes may be apart.

    Args:
        metres: of road.
        turn_rad: of turning.
    """

    metres: float
    turn_rad: float


@dataclass(frozen=True, eq=False)
class GraphNodes:
    """The K nodes of one robot.

    Args:
        trajectory: the keyframes.
        drift: of the odometry; biases are part of its random walk (see `without_bias`).
        keyframe: `(K,)` nearest keyframe, increasing; the first and the last keyframe have nodes.
        position: `(K, 3)` in the odometry frame.
        of_link: `(L,)` node of each link position that was given.
    """

    trajectory: Trajectory
    drift: DriftModel
    keyframe: IntArray
    position: FloatArray
    of_link: IntArray

    @classmethod
    def along(
        cls, trajectory: Trajectory, keyframe: IntArray, position: FloatArray, spacing: NodeSpacing
    ) -> GraphNodes:
        """Nodes at all link positions, and between them.

        Args:
            trajectory: the keyframes.
            keyframe: `(L,)` keyframe nearest to each link.
            position: `(L, 3)` antenna positions in the odometry frame.
            spacing: of nodes between the links.
        """
        # Measurements of one instant share a node: both directions of a link, links to several robots.
        places, of_link = np.unique(np.column_stack([keyframe, position]), axis=0, return_inverse=True)
        linked = places[:, 0].astype(np.int64)
        between = _stations(trajectory, linked, spacing)
        keyframes = np.concatenate([linked, between])
        order = np.argsort(keyframes, kind="stable")
        rank = np.empty(len(order), np.int64)
        rank[order] = np.arange(len(order))
        positions = np.concatenate([places[:, 1:], trajectory.positions[between]])
        drift = without_bias(trajectory.drift, float(trajectory.distance[-1]))
        return cls(trajectory, drift, keyframes[order], positions[order], rank[of_link.reshape(-1)])

    def __len__(self) -> int:
        return len(self.keyframe)

    def with_drift_scaled(self, factor: float) -> GraphNodes:
        """The same nodes with drift of `factor` times the standard deviations."""
        trajectory = replace(self.trajectory, drift=self.trajectory.drift.scaled(factor))
        return replace(self, trajectory=trajectory, drift=self.drift.scaled(factor))

    def steps(self) -> tuple[FloatArray, FloatArray]:
        """From each node to the next: translation `(K-1, 3)` and covariance `(K-1, 6, 6)`, both in odometry axes."""
        walk = AccumulatedDrift.along(self.trajectory.poses, self.drift).between(self.keyframe[:-1], self.keyframe[1:])
        axes = np.broadcast_to(np.eye(3), (len(walk), 3, 3))
        T_node_odom = se3.from_rotation_translation(axes, -self.position[1:])
        covariance = se3.rotate_covariance(se3.adjoint(T_node_odom), walk)
        return np.diff(self.position, axis=0), covariance + LEAST_SIGMA**2 * np.eye(6)

    def around_keyframes(self) -> tuple[IntArray, FloatArray]:
        """Node before each keyframe `(N,)`, and the share `(N,)` of the distance to the next node."""
        size = len(self.trajectory)
        before = np.clip(np.searchsorted(self.keyframe, np.arange(size), side="right") - 1, 0, max(len(self) - 2, 0))
        after = np.minimum(before + 1, len(self) - 1)
        distance = self.trajectory.distance
        start, end = distance[self.keyframe[before]], distance[self.keyframe[after]]
        share = np.divide(distance - start, end - start, out=np.zeros(size), where=end > start)
        return before, np.clip(share, 0.0, 1.0)

    def bridge_variance(self, before: IntArray, share: FloatArray) -> FloatArray:
        """Variance `(N,)` of keyframes about the straight blend of their two nodes' errors, m^2 in any direction.

        Brownian bridges over the distance l between the nodes: with h = s (l - s) / l, translation adds h, rotation
        l h^2 / 3 (its integral), and a turn somewhere between them at most h^2.
        """
        after = np.minimum(before + 1, len(self) - 1)
        length = self.trajectory.distance[self.keyframe[after]] - self.trajectory.distance[self.keyframe[before]]
        turned = turned_so_far(self.trajectory)
        turn = turned[self.keyframe[after]] - turned[self.keyframe[before]]
        h = share * (1 - share) * length
        drift = self.drift
        return np.asarray(
            drift.translation_walk**2 * h
            + drift.rotation_walk**2 * length * h**2 / 3
            + drift.rotation_walk_turning**2 * turn * h**2
        )


@dataclass(frozen=True, eq=False)
class TeamNodes:
    """The nodes of several robots, and which of them their links join.

    Nodes of all robots are numbered one robot after the other.

    Args:
        nodes: of each robot.
        links: kept measurements of pairs of robots.
        ends: for each pair, the node (of its robot) of each link at a and at b.
    """

    nodes: Mapping[str, GraphNodes]
    links: Mapping[tuple[str, str], KeptLinks]
    ends: Mapping[tuple[str, str], tuple[IntArray, IntArray]]

    @classmethod
    def along(
        cls,
        trajectories: Mapping[str, Trajectory],
        links: Mapping[tuple[str, str], KeptLinks],
        spacing: NodeSpacing,
    ) -> TeamNodes:
        """Nodes at all links of each robot, and between them."""
        nodes, at = {}, {}
        for robot, trajectory in trajectories.items():
            pairs = [pair for pair in links if robot in pair]
            ends = [links[pair].links.at(robot) for pair in pairs]
            nodes[robot] = GraphNodes.along(
                trajectory,
                np.concatenate([np.zeros(0, np.int64), *(keyframe for keyframe, _ in ends)]),
                np.concatenate([np.zeros((0, 3)), *(antenna for _, antenna in ends)]),
                spacing,
            )
            parts = np.split(nodes[robot].of_link, np.cumsum([len(keyframe) for keyframe, _ in ends])[:-1])
            at[robot] = dict(zip(pairs, parts, strict=True))
        return cls(nodes, links, {(a, b): (at[a][a, b], at[b][a, b]) for a, b in links})

    @cached_property
    def first(self) -> dict[str, int]:
        """Number of each robot's first node."""
        return dict(zip(self.nodes, np.cumsum([0, *(len(n) for n in self.nodes.values())]).tolist(), strict=False))

    @property
    def linked(self) -> tuple[IntArray, IntArray]:
        """Numbers of the nodes `(L,)` at both ends of all links."""
        none = np.zeros(0, np.int64)
        at_a = np.concatenate([none, *(self.first[a] + ends[0] for (a, _), ends in self.ends.items())])
        at_b = np.concatenate([none, *(self.first[b] + ends[1] for (_, b), ends in self.ends.items())])
        return at_a, at_b


def without_bias(drift: DriftModel, length_m: float) -> DriftModel:
    """A drift model of random walks only, that is nowhere below the given one on a trajectory of this length.

    A bias' variance grows with the square of the distance, b^2 s^2 <= (b^2 length) s.  Factors between neighbouring
    nodes are independent and cannot share a bias.
    """
    return DriftModel(
        translation_walk=float(np.hypot(drift.translation_walk, drift.translation_bias * np.sqrt(length_m))),
        rotation_walk=float(np.hypot(drift.rotation_walk, drift.rotation_bias * np.sqrt(length_m))),
        rotation_walk_turning=drift.rotation_walk_turning,
        translation_bias=0.0,
        rotation_bias=0.0,
    )


def turned_so_far(trajectory: Trajectory) -> FloatArray:
    """`(N,)` radians turned up to each keyframe."""
    R = trajectory.poses[:, :3, :3]
    trace = np.einsum("nij,nij->n", R[:-1], R[1:])
    return np.concatenate([[0.0], np.cumsum(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))])


def _stations(trajectory: Trajectory, links: IntArray, spacing: NodeSpacing) -> IntArray:
    """Keyframes for further nodes: both ends, and so many that no two nodes are further apart than allowed."""
    stage = trajectory.distance / spacing.metres + turned_so_far(trajectory) / spacing.turn_rad
    stage = stage * min(1.0, MOST_NODES / max(stage[-1], 1.0))
    fixed = np.unique(np.concatenate([links, [0, len(trajectory) - 1]]))
    gaps = np.ceil(np.diff(stage[fixed])).astype(np.int64)
    gap = np.repeat(np.arange(len(gaps)), np.maximum(gaps - 1, 0))
    nth = np.arange(len(gap)) - np.searchsorted(gap, gap) + 1
    at = stage[fixed[gap]] + (stage[fixed[gap + 1]] - stage[fixed[gap]]) * nth / gaps[gap]
    return np.setdiff1d(np.concatenate([np.searchsorted(stage, at), [0, len(trajectory) - 1]]), links)
