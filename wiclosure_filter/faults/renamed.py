"""By how much a team's measurements miss its odometry if its names are in another order: by geometry, without a search.

Where alignments fit, their measurements tell which path is the direct one, and so displacements between robots.  Other
robots' odometry would have to go with these under another order; the best rigid transform tells by how much it misses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from wiclosure import se3
from wiclosure.types import BoolArray, FloatArray, FrameAlignment, IntArray, Trajectory
from wiclosure.wiclosure_filter.links.links import Links


@dataclass(frozen=True, eq=False)
class Displacements:
    """What two robots' measurements tell by an alignment: D displacements.

    Args:
        robot_a, robot_b: the names.
        stamp_a_ns, stamp_b_ns: `(D,)`.
        a_receives: `(D,)`.
        seen: `(D,)` receiver to transmitter in the receiver's body axes, x + iy in metres.
        variance: `(D,)` m^2, in the vaguer direction.
    """

    robot_a: str
    robot_b: str
    stamp_a_ns: IntArray
    stamp_b_ns: IntArray
    a_receives: BoolArray
    seen: NDArray[np.complex128]
    variance: FloatArray

    @classmethod
    def of(cls, alignment: FrameAlignment, links: Links) -> Displacements:
        """Of the links whose direct path and range an alignment keeps."""
        kept = {} if alignment.best is None else dict(alignment.best.paths_kept)
        path = np.array([kept.get(int(m), -1) for m in links.measurement], np.int64)
        rows = np.flatnonzero((path >= 0) & links.has_range)
        links, column = links.subset(rows), np.argmax(links.path[rows] == path[rows, None], axis=1)
        row = np.arange(len(rows))
        azimuth, sigma = links.azimuth[row, column], links.sigma[row, column]
        in_axes = np.column_stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(rows))])
        direction = np.einsum("dij,dj->di", links.R_keyframe_axes, in_axes)
        variance = np.maximum(links.range_m * sigma, links.range_sigma_m) ** 2
        return cls(
            links.robot_a,
            links.robot_b,
            links.stamp_a_ns,
            links.stamp_b_ns,
            links.a_receives,
            links.range_m * (direction[:, 0] + 1j * direction[:, 1]),
            variance,
        )

    def chi2(self, names: Mapping[str, str], trajectories: Mapping[str, Trajectory]) -> float:
        """By which the best rigid transform misses them if each robot is called as `names` has it."""
        if len(self.seen) == 0:
            return 0.0
        in_a, turn_a = _at(trajectories[names[self.robot_a]], self.stamp_a_ns)
        in_b, turn_b = _at(trajectories[names[self.robot_b]], self.stamp_b_ns)
        p = in_a + np.where(self.a_receives, turn_a * self.seen, 0.0)
        q = in_b + np.where(self.a_receives, 0.0, turn_b * self.seen)
        weight = 1 / self.variance
        p, q = (points - points @ weight / weight.sum() for points in (p, q))
        turn = np.exp(1j * np.angle((p * np.conj(q)) @ weight))
        return float(np.abs(p - turn * q) ** 2 @ weight)


def _at(trajectory: Trajectory, stamp_ns: IntArray) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Where a robot is, x + iy in metres, and how it is turned, by the keyframes nearest in time."""
    after = np.clip(np.searchsorted(trajectory.stamps_ns, stamp_ns), 1, max(len(trajectory) - 1, 1))
    before_is_nearer = stamp_ns - trajectory.stamps_ns[after - 1] < trajectory.stamps_ns[after] - stamp_ns
    poses = trajectory.poses[np.where(before_is_nearer, after - 1, after)]
    return poses[:, 0, 3] + 1j * poses[:, 1, 3], np.exp(1j * se3.yaw(poses))


def missed(
    displacements: list[Displacements], names: Mapping[str, str], trajectories: Mapping[str, Trajectory]
) -> float:
    """Natural logarithm of the odds against an order of the names; residuals are held against those of what is claimed.

    Drift is in both.
    """
    as_claimed = {robot: robot for robot in trajectories}
    against = 0.0
    for told in displacements:
        scatter = max(told.chi2(as_claimed, trajectories) / max(2 * len(told.seen) - 3, 1), 1.0)
        against += (told.chi2(names, trajectories) - told.chi2(as_claimed, trajectories)) / scatter / 2
    return against
