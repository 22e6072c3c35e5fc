"""Where a robot was, when, and how far that can be trusted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from wiclosure import se3
from wiclosure.arrays import BoolArray, FloatArray, IntArray, float_array, stamp_array
from wiclosure.drift import AccumulatedDrift, AccumulatedSteps, DriftModel
from wiclosure.errors import InputError

_NO_ROTATION = 1e-3  # rotations printed with four decimals are nearer to one than this
_SHORTEST_STEP_NS = 1_000  # a million poses a second are no robot's odometry


@dataclass(frozen=True, eq=False, repr=False)
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

    Raises:
        InputError: stamps that are no integer nanoseconds or do not increase; poses that are no rotation and
            translation; shapes that do not belong together.  Lists are converted.
    """

    robot: str
    stamps_ns: IntArray
    poses: FloatArray
    drift: DriftModel = field(default_factory=DriftModel)
    finer: Trajectory | None = None
    step_covariances: FloatArray | None = None
    parents: IntArray | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.robot, str):
            raise InputError(f"a trajectory begins with the robot's name; expected a string, got {type(self.robot)}")
        name = f"trajectory of {self.robot}"
        object.__setattr__(self, "poses", float_array(self.poses, f"{name}: poses"))
        object.__setattr__(self, "stamps_ns", stamp_array(self.stamps_ns, f"{name}: stamps"))
        if self.poses.ndim != 3 or self.poses.shape[1:] != (4, 4) or len(self.poses) == 0:
            raise InputError(f"{name}: poses have shape {self.poses.shape}; expected (N, 4, 4), N >= 1")
        if self.stamps_ns.shape != (len(self.poses),):
            raise InputError(f"{name}: {len(self.poses)} poses but stamps of shape {self.stamps_ns.shape}")
        if self.step_covariances is not None:
            object.__setattr__(self, "step_covariances", float_array(self.step_covariances, f"{name}: covariances"))
            if self.step_covariances.shape != (len(self.poses) - 1, 6, 6):
                raise InputError(
                    f"{name}: {len(self.poses)} poses but step covariances of shape {self.step_covariances.shape};"
                    " expected (N - 1, 6, 6)"
                )
        if self.parents is not None:
            _require_tree(self.parents, len(self.poses), name, stated=self.step_covariances is not None)
        _require_poses(self.poses, name)
        _require_order(self.stamps_ns, name)
        _require_nanoseconds(self.stamps_ns, name)

    def __repr__(self) -> str:
        seconds = (int(self.stamps_ns[-1]) - int(self.stamps_ns[0])) * 1e-9
        return f"Trajectory({self.robot!r}, {len(self)} poses, {seconds:.1f} s, {self.distance[-1]:.1f} m)"

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

    def at_or_beyond(self, stamps_ns: IntArray) -> FloatArray:
        """The same, but before the first pose and after the last the motion goes on evenly, for two steps at most."""
        poses, known = self.at(stamps_ns), self._known
        if len(known) < 2:
            return poses
        for end, inner, outside in (
            (0, 1, stamps_ns < known.stamps_ns[0]),
            (-1, -2, stamps_ns > known.stamps_ns[-1]),
        ):
            if outside.any():
                step_ns = int(known.stamps_ns[inner] - known.stamps_ns[end])
                share = np.clip((stamps_ns[outside] - known.stamps_ns[end]) / step_ns, -2.0, 0.0)
                step = se3.log(se3.between(known.poses[end], known.poses[inner]))
                poses[outside] = known.poses[end] @ se3.exp(share[:, None] * step)
        return poses

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

    def loosened(self, factor: float) -> Trajectory:
        """The same trajectory with all standard deviations of its errors so many times as large."""
        finer = None if self.finer is None else self.finer.loosened(factor)
        stated = None if self.step_covariances is None else factor**2 * self.step_covariances
        return replace(self, drift=self.drift.scaled(factor), finer=finer, step_covariances=stated)

    def loosened_step(self, index: int, covariance: FloatArray) -> Trajectory:
        """The same with a covariance `(6, 6)` more of the one step to the pose at `index`; all are then stated."""
        first, second = self.steps(np.arange(len(self)))
        stated = self.relative_covariance(first, second).copy()
        stated[index - 1] += covariance
        return replace(self, step_covariances=stated)

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

    def translation_variance_between(self, i: IntArray, j: IntArray) -> FloatArray:
        """Traces `(M,)` of the translation block of the same covariances, likewise."""
        return self._accumulated_drift.translation_variance(self.poses, np.asarray(i), np.asarray(j))


def require_own_names(trajectories: Mapping[str, Trajectory]) -> None:
    """Fails where a trajectory stands under another robot's name.

    Raises:
        InputError: names the key and the robot.
    """
    for key, trajectory in trajectories.items():
        if key != trajectory.robot:
            raise InputError(
                f"the trajectory under {key!r} is of robot {trajectory.robot!r}; give it the name of its key"
            )


def _require_poses(poses: FloatArray, name: str) -> None:
    """All `(N, 4, 4)` finite, a rotation and a translation."""
    finite = np.isfinite(poses).all(axis=(1, 2))
    if not finite.all():
        raise InputError(f"{name}: pose {np.argmin(finite)} is not finite; leave it out")
    affine = (poses[:, 3] == np.array([0.0, 0.0, 0.0, 1.0])).all(axis=1)
    if not affine.all():
        row = int(np.argmin(affine))
        raise InputError(f"{name}: the last row of pose {row} is {poses[row, 3].tolist()}; expected [0, 0, 0, 1]")
    rotations = poses[:, :3, :3]
    squares = np.einsum("nji,njk->nik", rotations, rotations)
    off = np.abs(squares - np.eye(3)).max(axis=(1, 2))
    if off.max() > _NO_ROTATION:
        row = int(np.argmax(off > _NO_ROTATION))
        scale = float(np.sqrt(np.trace(squares[row]) / 3))
        scaled = np.abs(squares[row] - scale**2 * np.eye(3)).max() <= _NO_ROTATION * scale**2
        how = f"is scaled by {scale:.4g}" if scaled else "has columns that are not orthonormal"
        raise InputError(f"{name}: the rotation of pose {row} {how}; make it one (scipy: Rotation.from_matrix)")
    handed = np.einsum("ni,ni->n", rotations[:, :, 0], np.cross(rotations[:, :, 1], rotations[:, :, 2]))
    if handed.min() < 0:
        row = int(np.argmax(handed < 0))
        raise InputError(f"{name}: the rotation of pose {row} is mirrored (determinant -1); axes must be right-handed")


def _require_order(stamps_ns: IntArray, name: str) -> None:
    back = np.flatnonzero(np.diff(stamps_ns) <= 0)
    if len(back):
        raise InputError(
            f"{name}: the stamp of pose {back[0] + 1} does not follow that of pose {back[0]};"
            " sort the poses by time and drop repeated ones"
        )


def _require_nanoseconds(stamps_ns: IntArray, name: str) -> None:
    """Integers that count seconds or milliseconds are known by how near they lie: half of the steps must say so."""
    step_ns = float(np.median(np.diff(stamps_ns))) if len(stamps_ns) > 1 else np.inf
    if step_ns < _SHORTEST_STEP_NS:
        raise InputError(
            f"{name}: by its stamps ({stamps_ns[0]}, {stamps_ns[1]} ...) it has a pose every {step_ns:g} ns;"
            " stamps are nanoseconds, so multiply seconds by 10**9"
        )


def _require_tree(parents: IntArray, size: int, name: str, *, stated: bool) -> None:
    latest = np.maximum(np.arange(size) - 1, 0)
    if parents.shape != (size,) or (parents > latest).any() or (parents < 0).any() or not stated:
        raise InputError(
            f"{name}: parents must be {size} earlier poses, with a covariance for each step; sort the poses along the"
            " odometry"
        )
