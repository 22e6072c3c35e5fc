"""Where a robot was, when, and how far that can be trusted."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.arrays import BoolArray, FloatArray, IntArray
from wiclosure.drift import AccumulatedDrift, AccumulatedSteps, DriftModel
from wiclosure.errors import InputError


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The poses of one robot in one frame, usually its odometry frame.

    Args:
        robot: name of the robot.
        stamps_ns: `(N,)` int64, strictly increasing, N >= 1.
        poses: `(N, 4, 4)` `T_odom_body`.
        drift: how the error between two poses grows along the path.
        finer: the trajectory that these poses were chosen from, as keyframes are: `at` and `covers` look there, so that
            a robot which stands still between keyframes, or after the last, has a pose at every stamp.
        step_covariances: `(N - 1, 6, 6)` of `relative_pose(parents[n], n)` for n = 1 to N - 1, where the source states
            them; the drift model is then not used.
        parents: `(N,)` the pose that the step to each pose starts from, an earlier one; 0 for the first pose. None: the
            pose before. Odometry that branches is stated, so that `step_covariances` come with it.
    """

    robot: str
    stamps_ns: IntArray
    poses: FloatArray
    drift: DriftModel = field(default_factory=DriftModel)
    finer: Trajectory | None = None
    step_covariances: FloatArray | None = None
    parents: IntArray | None = None

    def __post_init__(self) -> None:
        if self.poses.ndim != 3 or self.poses.shape[1:] != (4, 4) or len(self.poses) == 0:
            raise InputError(
                f"trajectory of {self.robot}: poses have shape {self.poses.shape}; expected (N, 4, 4), N >= 1"
            )
        if self.stamps_ns.shape != (len(self.poses),):
            raise InputError(
                f"trajectory of {self.robot}: {len(self.poses)} poses but stamps of shape {self.stamps_ns.shape}"
            )
        if self.step_covariances is not None and self.step_covariances.shape != (len(self.poses) - 1, 6, 6):
            raise InputError(
                f"trajectory of {self.robot}: {len(self.poses)} poses but step covariances of shape"
                f" {self.step_covariances.shape}; expected (N - 1, 6, 6)"
            )
        if self.parents is not None:
            _require_tree(self.robot, self.parents, len(self.poses), stated=self.step_covariances is not None)
        if not np.isfinite(self.poses).all():
            row = int(np.argmin(np.isfinite(self.poses).all(axis=(1, 2))))
            raise InputError(f"trajectory of {self.robot}: pose {row} is not finite")
        back = np.flatnonzero(np.diff(self.stamps_ns) <= 0)
        if len(back):
            raise InputError(
                f"trajectory of {self.robot}: the stamp of pose {back[0] + 1} does not follow that of pose {back[0]};"
                " sort the poses by time and drop repeated ones"
            )

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def _known(self) -> Trajectory:
        """All poses that are known."""
        return self if self.finer is None else self.finer

    @property
    def positions(self) -> FloatArray:
        """`(N, 3)` positions in the frame of the trajectory."""
        return self.poses[:, :3, 3]

    @cached_property
    def distance(self) -> FloatArray:
        """`(N,)` metres travelled up to each pose."""
        steps = np.linalg.norm(np.diff(self.positions, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps)])

    @cached_property
    def _accumulated_drift(self) -> AccumulatedDrift | AccumulatedSteps:
        if self.step_covariances is not None:
            return AccumulatedSteps.along(self.poses, self.step_covariances, self.parents)
        return AccumulatedDrift.along(self.poses, self.drift)

    def covers(self, stamps_ns: IntArray, tolerance_ns: int = 0) -> BoolArray:
        """Which of the stamps `(M,)` lie within the time of the trajectory."""
        first_ns, last_ns = self._known.stamps_ns[[0, -1]]
        after, before = first_ns - tolerance_ns, last_ns + tolerance_ns
        return np.asarray((stamps_ns >= after) & (stamps_ns <= before))

    def at(self, stamps_ns: IntArray) -> FloatArray:
        """Interpolated poses `(M, 4, 4)`; stamps outside take the nearest end (ask `covers` first)."""
        return se3.interpolate(self._known.stamps_ns, self._known.poses, stamps_ns)

    def nearest(self, stamps_ns: IntArray) -> IntArray:
        """Indices `(M,)` of the poses nearest in time."""
        upper = np.clip(np.searchsorted(self.stamps_ns, stamps_ns), 1, max(len(self) - 1, 1))
        lower = upper - 1
        upper = np.minimum(upper, len(self) - 1)
        return np.where(stamps_ns - self.stamps_ns[lower] <= self.stamps_ns[upper] - stamps_ns, lower, upper)

    def subset(self, indices: IntArray) -> Trajectory:
        """The trajectory through the poses at `indices` (increasing) alone."""
        stated = parents = None
        if self.step_covariances is not None:
            first, second = self.steps(indices)
            stated = self.relative_covariance(first, second)
            if self.parents is not None:
                parents = np.concatenate([[0], np.searchsorted(indices, first)])
        return Trajectory(self.robot, self.stamps_ns[indices], self.poses[indices], self.drift, None, stated, parents)

    def keyframes(self, indices: IntArray) -> Trajectory:
        """The poses at `indices` (increasing) as keyframes, which remember the poses between."""
        return replace(self.subset(indices), finer=self._known)

    def moved(self, T_new_odom: FloatArray) -> Trajectory:
        """The same trajectory in another frame: poses `T_new_odom @ T_odom_body`."""
        finer = None if self.finer is None else self.finer.moved(T_new_odom)
        poses = T_new_odom @ self.poses
        return Trajectory(self.robot, self.stamps_ns, poses, self.drift, finer, self.step_covariances, self.parents)

    @property
    def junctions(self) -> IntArray:
        """Indices of the poses that several steps start from; with them a subset has the same odometry."""
        if self.parents is None:
            return np.zeros(0, np.int64)
        return np.flatnonzero(np.bincount(self.parents[1:], minlength=len(self)) > 1)

    def steps(self, indices: IntArray) -> tuple[IntArray, IntArray]:
        """First and second poses `(M - 1,)` of the odometry steps that join the poses at `indices (M,)` (increasing).

        Each pose is joined to the nearest one before it along the odometry: in a chain, to the one before.
        """
        if self.parents is None:
            return indices[:-1], indices[1:]
        kept = np.zeros(len(self), bool)
        kept[indices] = True
        kept[0] = True
        nearest = self.parents
        for _ in range(len(self).bit_length()):  # by pointer jumping: twice as far each time
            nearest = np.where(kept[nearest], nearest, nearest[nearest])
        first = nearest[indices[1:]]
        return np.maximum(first, indices[0]), indices[1:]

    def relative_pose(self, i: IntArray, j: IntArray) -> FloatArray:
        """`T_i_j` `(M, 4, 4)` for index arrays `(M,)`."""
        return se3.between(self.poses[i], self.poses[j])

    def relative_covariance(self, i: IntArray, j: IntArray) -> FloatArray:
        """Covariances `(M, 6, 6)` of `relative_pose(i, j)` by the drift model or as stated, O(1) a pair."""
        return se3.rotate_covariance(se3.adjoint(se3.inverse(self.poses[j])), self.drift_between(i, j))

    def drift_between(self, i: IntArray, j: IntArray) -> FloatArray:
        """The same covariances `(M, 6, 6)`, as errors in the odometry frame instead of frame j."""
        return self._accumulated_drift.between(np.asarray(i), np.asarray(j))

    def rotation_variance_between(self, i: IntArray, j: IntArray) -> FloatArray:
        """Traces `(M,)` of the rotation block of the same covariances, at a fraction of the cost."""
        return self._accumulated_drift.rotation_variance(np.asarray(i), np.asarray(j))


def _require_tree(robot: str, parents: IntArray, size: int, *, stated: bool) -> None:
    earlier = np.arange(size) - 1
    if parents.shape != (size,) or (parents > np.maximum(earlier, 0)).any() or (parents < 0).any() or not stated:
        raise InputError(
            f"trajectory of {robot}: parents must be {size} earlier poses, with a covariance for each step; sort the"
            " poses along the odometry"
        )
