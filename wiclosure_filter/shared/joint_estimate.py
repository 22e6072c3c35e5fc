"""One estimate over the keyframes of all robots and all links that the alignments kept (GTSAM).

The paper takes one link for each pair of poses, since one link leaves the trajectories as they are.  Here all links are
used at once, which also corrects the odometry, and robots that never heard each other are joined through a third.

What is exact and what is a bound: means and joint covariance of the nodes are those of the linearised problem, with
all their correlations, and with the constant errors of all links and odometries as variables of it.  A keyframe's error
is the blend of its two nodes' errors plus a bridge between them; the covariance of two keyframes' displacement is taken
as the blend of the four node pairs' covariances, which is never smaller than that of the blend (variance is convex),
plus both bridges.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, IntArray, PredictionKind
from wiclosure.wiclosure_filter.covariance.joint_covariance import JointCovariance
from wiclosure.wiclosure_filter.covariance.square_root import SquareRoot
from wiclosure.wiclosure_filter.search.gates import Gate
from wiclosure.wiclosure_filter.search.pair_model import KeyframePlaces, PairModel
from wiclosure.wiclosure_filter.shared.graph_nodes import GraphNodes
from wiclosure.wiclosure_filter.shared.joint_optimum import JointOptimum
from wiclosure.wiclosure_filter.shared.reach import Reach, meeting_stretches, near_enough
from wiclosure.workers import batches

_AT_ONCE = 32  # robots whose columns of the joint covariance are computed together


@dataclass(frozen=True, eq=False)
class JointEstimate:
    """The shared trajectory of the robots of one component.

    The frame is the odometry frame of the first robot.

    Args:
        nodes: graph nodes of each robot.
        first: index of each robot's first node among all nodes.
        T_world_node: `(K, 4, 4)` of all nodes.
        covariance: of all nodes jointly, in the axes of the shared frame.
        dimensions: 2 where displacements are horizontal, 3 in space.
    """

    nodes: Mapping[str, GraphNodes]
    first: Mapping[str, int]
    T_world_node: FloatArray
    covariance: JointCovariance
    dimensions: int
    kind: ClassVar[PredictionKind] = PredictionKind.POSE
    alternatives: ClassVar[int] = 1

    @classmethod
    def of(cls, optimum: JointOptimum) -> JointEstimate:
        """With covariances.

        Raises:
            numpy.linalg.LinAlgError: some node is not determined.
        """
        nodes, first, T_world_node = optimum.team.nodes, optimum.team.first, optimum.T_world_node
        bounds = np.array([*first.values(), len(T_world_node)])
        root, linked = SquareRoot.of(optimum.eliminated), optimum.team.linked
        covariance = JointCovariance(root, bounds, T_world_node[:, :3, :3], linked)
        return cls(nodes, first, T_world_node, covariance, optimum.dimensions)

    def models(self, robot_a: str, robot_b: str, gate: Gate | None = None) -> tuple[PairModel, ...]:
        """Predicted displacements between all keyframes of two robots; see `SharedEstimate`."""
        a, b = self.reach[robot_a], self.reach[robot_b]
        of_a, of_b = slice(0, len(a.places)), slice(0, len(b.places))
        if gate is not None:
            stretches = meeting_stretches(a, b, self._of_middles(robot_a, robot_b), gate)
            if stretches is None:
                return ()
            of_a, of_b = stretches
        (places_a, nodes_a), (places_b, nodes_b) = a.places.stretch(of_a), b.places.stretch(of_b)
        rows_a, rows_b = (self.covariance.positions(self._number[r], self.dimensions) for r in (robot_a, robot_b))
        table = rows_a.only(nodes_a).displacements(rows_b.only(nodes_b))
        return (PairModel(places_a, places_b, table, first=(of_a.start, of_b.start)),)

    def _of_middles(self, robot_a: str, robot_b: str) -> FloatArray:
        """`(12, 12)` covariance of the middle nodes of two robots, in the shared axes."""
        return self.covariance.of_two(self._middle(robot_a), self._middle(robot_b))

    def may_meet(self, gate: Gate) -> set[tuple[str, str]]:
        """See `SharedEstimate`."""
        robots = list(self.nodes)
        near = np.triu(near_enough([self.reach[robot] for robot in robots], gate), 1)
        middles = np.array([self._middle(robot) for robot in robots])
        for ranked in batches([self._number[robot] for robot in self._ranks], _AT_ONCE):
            self.covariance.learn(middles[ranked], [middles[near[number]] for number in ranked])
        return {(robots[i], robots[j]) for i, j in zip(*np.nonzero(near), strict=True)}

    def _middle(self, robot: str) -> int:
        """Number of the node that stands for a robot as a whole."""
        return self.first[robot] + len(self.nodes[robot]) // 2

    def rank(self, robot: str) -> int:
        """See `SharedEstimate`."""
        return self._ranks[robot]

    @cached_property
    def _ranks(self) -> dict[str, int]:
        """By the middle of each robot's cliques, which lie near each other for nodes of one part of the plan."""
        middle = {robot: float(np.median(self.covariance.root.clique_of[self._rows(robot)])) for robot in self.nodes}
        return {robot: rank for rank, robot in enumerate(sorted(middle, key=middle.__getitem__))}

    @cached_property
    def reach(self) -> dict[str, Reach]:
        """Each robot in the shared frame, without the others."""
        found: dict[str, Reach] = {}
        for robots in batches(list(self._ranks), _AT_ONCE):
            middles = [self._middle(robot) - self.first[robot] for robot in robots]
            of_each = self.covariance.about([self._number[robot] for robot in robots], middles)
            for robot, middle, (own, with_middle) in zip(robots, middles, of_each, strict=True):
                found[robot] = self._reach(robot, middle, own, with_middle)
        return found

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """`T_a_b (M, 4, 4)` and covariances `(M, 6, 6)`: over the nearest nodes, with their joint covariance."""
        if len(index_a) == 0:
            return np.zeros((0, 4, 4)), np.zeros((0, 6, 6))
        node_a, T_node_a, C_a = self._nearest(robot_a, index_a)
        node_b, T_node_b, C_b = self._nearest(robot_b, index_b)
        T_nodes, C_nodes = self._between_nodes(node_a, node_b)
        T_a_node = se3.inverse(T_node_a)
        C_ab = se3.compose_covariance(se3.inverse_covariance(T_node_a, C_a), T_nodes, C_nodes)
        C_ab = se3.compose_covariance(C_ab, T_node_b, C_b)
        T_a_b = T_a_node @ T_nodes @ T_node_b
        # The positions that the gate saw: blended, not those of the nearest node alone.
        apart = self.positions[robot_b][index_b] - self.positions[robot_a][index_a]
        R_world_a = self.T_world_node[node_a, :3, :3] @ T_node_a[:, :3, :3]
        T_a_b[:, :3, 3] = np.einsum("mji,mj->mi", R_world_a, apart)
        return T_a_b, C_ab

    def _rows(self, robot: str) -> slice:
        return slice(self.first[robot], self.first[robot] + len(self.nodes[robot]))

    @cached_property
    def _number(self) -> dict[str, int]:
        return {robot: number for number, robot in enumerate(self.nodes)}

    def _between_nodes(self, n: IntArray, m: IntArray) -> tuple[FloatArray, FloatArray]:
        """`T_n_m` and its covariance, exact to first order, for nodes of two robots."""
        T_n_m = se3.between(self.T_world_node[n], self.T_world_node[m])
        to_n, to_m = (_turned(np.swapaxes(self.T_world_node[i, :3, :3], 1, 2)) for i in (n, m))
        own_n, own_nm, own_m = self.covariance.of_pairs(n, m)
        C_nn = to_n @ own_n @ np.swapaxes(to_n, 1, 2)
        C_mm = to_m @ own_m @ np.swapaxes(to_m, 1, 2)
        C_mn = to_m @ np.swapaxes(own_nm, 1, 2) @ np.swapaxes(to_n, 1, 2)
        Ad = se3.adjoint(se3.inverse(T_n_m))
        mixed = C_mn @ np.swapaxes(Ad, 1, 2)
        return T_n_m, C_mm + se3.rotate_covariance(Ad, C_nn) - mixed - np.swapaxes(mixed, 1, 2)

    def _nearest(self, robot: str, index: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
        """Nearest node (among all), `T_node_keyframe` and the covariance of the odometry between."""
        nodes, trajectory = self.nodes[robot], self.nodes[robot].trajectory
        before, share = self.reach[robot].places.node[index], self.reach[robot].places.fraction[index]
        node = np.where(share > 0.5, before + 1, before)
        T_node_keyframe = trajectory.poses[index].copy()
        T_node_keyframe[:, :3, 3] -= nodes.position[node]
        drift = trajectory.relative_covariance(nodes.keyframe[node], index) + 1e-8 * np.eye(6)
        return node + self.first[robot], T_node_keyframe, drift

    @cached_property
    def positions(self) -> dict[str, FloatArray]:
        """`(N, 3)` positions of all keyframes of each robot in the shared frame."""
        return {robot: self._positions(robot) for robot in self.nodes}

    def _positions(self, robot: str) -> FloatArray:
        nodes = self.nodes[robot]
        before, share = nodes.around_keyframes()
        after = np.minimum(before + 1, len(nodes) - 1)
        T_world_node, odometry = self.T_world_node[self._rows(robot)], nodes.trajectory.positions
        from_before, from_after = (
            se3.transform(T_world_node[n], odometry - nodes.position[n]) for n in (before, after)
        )
        return from_before + share[:, None] * (from_after - from_before)

    def _reach(self, robot: str, middle: int, own: FloatArray, with_middle: FloatArray) -> Reach:
        nodes = self.nodes[robot]
        before, share = nodes.around_keyframes()
        after = np.minimum(before + 1, len(nodes) - 1)
        chord = nodes.position[before] + share[:, None] * (nodes.position[after] - nodes.position[before])
        off_chord = np.sum((nodes.trajectory.positions - chord) ** 2, axis=1)
        turn = np.einsum("nii->n", own[:, :3, :3])
        variance = nodes.bridge_variance(before, share) + off_chord * np.maximum(turn[before], turn[after])
        places = KeyframePlaces(
            positions=self.positions[robot][:, : self.dimensions],
            own_covariance=variance[:, None, None] * np.eye(self.dimensions),
            node=before,
            fraction=share,
        )
        return Reach.of(places, self.T_world_node[self._rows(robot), :3, 3], middle, own, with_middle)


def _turned(R: FloatArray) -> FloatArray:
    """`(M, 6, 6)` that turns rotation and translation parts alike."""
    both = np.zeros((len(R), 6, 6))
    both[:, :3, :3] = both[:, 3:, 3:] = R
    return both
