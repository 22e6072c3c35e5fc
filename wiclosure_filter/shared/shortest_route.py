"""The paper's shared trajectory: each pair of poses through one link, the one with the shortest route (section IV-C).

    T^p_k     = T^p_c1 T^c1_c2 T^c2_k                                        (eq. 13)
    Sigma_pk  = Sigma_p,c1 + J Sigma_c1,c2 J^T + J Sigma_c2,k J^T            (eq. 14)

The links do not alter the trajectories.  A measurement fixes where the antennas are; the rotation between the frames,
on which the paper is silent, comes from the alignment with its yaw's variance.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, IntArray, PredictionKind, Trajectory
from wiclosure.wiclosure_filter.search.gates import Gate
from wiclosure.wiclosure_filter.search.pair_model import KeyframePlaces, PairModel, ShortestRoutes
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

# m^2, so that no covariance is singular at the link itself.
VARIANCE_FLOOR = 1e-4


@dataclass(frozen=True, eq=False)
class ShortestRouteEstimate:
    """Two robots joined by L links with range and bearing.

    Args:
        trajectories: of robots a and b.
        T_a_b: `(L, 4, 4)` frame of b in that of a, by each link alone.
        covariance: `(L, 3, 3)` m^2 of the displacement between the antennas, in the axes of a.
        centre_b: `(L, 3)` where b turns about when the yaw is wrong: its end of the link, or, seen from b, the other's.
        yaw_variance: rad^2.
        keyframe_a, keyframe_b: `(L,)` keyframes at the links.
        dimensions: 2 or 3.
    """

    robot_a: str
    robot_b: str
    trajectories: Mapping[str, Trajectory]
    T_a_b: FloatArray
    covariance: FloatArray
    centre_b: FloatArray
    yaw_variance: float
    keyframe_a: IntArray
    keyframe_b: IntArray
    dimensions: int
    kind: ClassVar[PredictionKind] = PredictionKind.POSE
    alternatives: ClassVar[int] = 1

    @classmethod
    def of(
        cls, kept: KeptLinks, alignment: FrameAlignment, trajectories: Mapping[str, Trajectory], dimensions: int
    ) -> ShortestRouteEstimate | None:
        """From the kept links of an alignment; None where no link has both range and bearing."""
        links = kept.links
        whole = np.flatnonzero(np.isfinite(links.range_m) & np.isfinite(kept.direction).all(axis=1))
        if alignment.best is None or alignment.covariance is None or len(whole) == 0:
            return None
        R = alignment.best.T_a_b[:3, :3]
        d, u = links.range_m[whole, None], kept.direction[whole]
        a_receives = links.a_receives[whole, None]
        antenna_a, antenna_b = links.antenna_a[whole], links.antenna_b[whole]
        displacement = d * u
        # a hears b: antenna_b lies at antenna_a + d u.  b hears a: antenna_a lies at antenna_b + d u, in b's frame.
        centre_b = np.where(a_receives, antenna_b, antenna_b + displacement)
        in_a = np.where(a_receives, antenna_a + displacement, antenna_a)
        T_a_b = se3.from_rotation_translation(np.broadcast_to(R, (len(whole), 3, 3)), in_a - centre_b @ R.T)
        C = (links.range_sigma_m[whole] ** 2)[:, None, None] * u[:, :, None] * u[:, None, :]
        C += (d**2)[:, :, None] * kept.direction_covariance[whole]
        C = np.where(a_receives[:, :, None], C, R @ C @ R.T)
        return cls(
            links.robot_a,
            links.robot_b,
            trajectories,
            T_a_b,
            C,
            centre_b,
            float(alignment.covariance[2, 2]),
            links.index_a[whole],
            links.index_b[whole],
            dimensions,
        )

    def rank(self, robot: str) -> int:
        """See `SharedEstimate`."""
        return 0

    def may_meet(self, gate: Gate) -> set[tuple[str, str]]:
        """The two robots; see `SharedEstimate`."""
        return {(self.robot_a, self.robot_b)}

    def models(self, robot_a: str, robot_b: str, gate: Gate | None = None) -> tuple[PairModel, ...]:
        """One model for each link, which answers for the pairs whose shortest route leads over it."""
        if (robot_a, robot_b) != (self.robot_a, self.robot_b):
            return ()
        routes_a, routes_b = self._routes()
        return tuple(
            PairModel(*self._places(link), self._table(link), ShortestRoutes(routes_a, routes_b, link))
            for link in range(len(self.T_a_b))
        )

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """`T_p_k (M, 4, 4)` and `(M, 6, 6)` over the shortest routes (eq. 13, 14)."""
        routes_a, routes_b = self._routes()
        link = np.argmin(routes_a[:, index_a] + routes_b[:, index_b], axis=0)
        a, b = self.trajectories[robot_a], self.trajectories[robot_b]
        c1, c2 = self.keyframe_a[link], self.keyframe_b[link]
        T_c1_c2 = se3.inverse(a.poses[c1]) @ self.T_a_b[link] @ b.poses[c2]
        C = np.zeros((len(link), 6, 6))
        R_a_c2 = self.T_a_b[link, :3, :3] @ b.poses[c2, :3, :3]
        C[:, :3, :3] = self.yaw_variance * np.eye(3)
        C[:, 3:, 3:] = np.swapaxes(R_a_c2, 1, 2) @ self.covariance[link] @ R_a_c2 + VARIANCE_FLOOR * np.eye(3)
        C_a, C_b = a.relative_covariance(index_a, c1), b.relative_covariance(c2, index_b)
        T_c2_k = b.relative_pose(c2, index_b)
        C = se3.compose_covariance(se3.compose_covariance(C_a, T_c1_c2, C), T_c2_k, C_b)
        return a.relative_pose(index_a, c1) @ T_c1_c2 @ T_c2_k, C + 1e-8 * np.eye(6)

    def _routes(self) -> tuple[FloatArray, FloatArray]:
        """Metres of road from every keyframe to every link, `(L, N_a)` and `(L, N_b)`."""
        a, b = self.trajectories[self.robot_a].distance, self.trajectories[self.robot_b].distance
        return np.abs(a - a[self.keyframe_a, None]), np.abs(b - b[self.keyframe_b, None])

    def _table(self, link: int) -> FloatArray:
        d = self.dimensions
        return self.covariance[None, None, link, :d, :d] + VARIANCE_FLOOR * np.eye(d)

    def _places(self, link: int) -> tuple[KeyframePlaces, KeyframePlaces]:
        a, b = self.trajectories[self.robot_a], self.trajectories[self.robot_b]
        own_a = _odometry_covariance(a, int(self.keyframe_a[link]), np.eye(3))
        R = self.T_a_b[link, :3, :3]
        lever = (b.positions - self.centre_b[link]) @ R.T
        across = np.cross([0.0, 0.0, 1.0], lever)
        own_b = _odometry_covariance(b, int(self.keyframe_b[link]), R)
        own_b += self.yaw_variance * across[:, :, None] * across[:, None, :]
        d = self.dimensions
        return (
            _without_nodes(a.positions[:, :d], own_a[:, :d, :d]),
            _without_nodes(se3.transform(self.T_a_b[link], b.positions)[:, :d], own_b[:, :d, :d]),
        )


def _odometry_covariance(trajectory: Trajectory, start: int, R_new_odom: FloatArray) -> FloatArray:
    """Covariance `(N, 3, 3)` of all positions relative to that of one keyframe, in new axes."""
    size = len(trajectory)
    covariance = trajectory.relative_covariance(np.full(size, start), np.arange(size))[:, 3:, 3:]
    R = R_new_odom @ trajectory.poses[:, :3, :3]
    return R @ covariance @ np.swapaxes(R, 1, 2)


def _without_nodes(positions: FloatArray, own_covariance: FloatArray) -> KeyframePlaces:
    size = len(positions)
    return KeyframePlaces(positions, own_covariance, np.zeros(size, np.int64), np.zeros(size))
