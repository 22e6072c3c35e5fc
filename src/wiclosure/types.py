"""The nouns that all rooms share.

Frozen dataclasses that validate shapes and values when made.  `T_a_b` maps points of frame b into frame a; x forward, y
left, z up; metres and radians; time is integer nanoseconds.  Tangent vectors and covariances are ordered
`[rotation, translation]` and live in the second frame of the transform they belong to (see `wiclosure.se3`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import Literal, Protocol, Self, TypeAlias

import numpy as np
from numpy.typing import NDArray

from wiclosure import se3
from wiclosure.drift import AccumulatedDrift, AccumulatedSteps, DriftModel
from wiclosure.errors import InputError

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
Float32Array: TypeAlias = NDArray[np.float32]

AoaFrame: TypeAlias = Literal["body", "odometry", "world"]

Prior: TypeAlias = tuple[FloatArray, FloatArray]
"""A predicted relative pose: `T_a_b (4, 4)` and its covariance `(6, 6)`."""


# ------------------------------------------------------------------------------------------------------------- scans
@dataclass(frozen=True, slots=True, eq=False)
class Scan:
    """One LiDAR sweep in the sensor's axes.

    Args:
        stamp_ns: time of the scan, as its source states it.
        points: `(N, 3)` float64, metres; finite, without returns at the origin.
        times: `(N,)` seconds after `stamp_ns` (may be negative) at which each point was measured, or None.
        intensity: `(N,)`, or None.
    """

    stamp_ns: int
    points: FloatArray
    times: FloatArray | None = None
    intensity: Float32Array | None = None

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3:
            raise ValueError(f"scan points have shape {self.points.shape}; expected (N, 3)")
        for name, values in (("times", self.times), ("intensity", self.intensity)):
            if values is not None and values.shape != (len(self.points),):
                raise ValueError(f"scan {name} have shape {values.shape}; expected ({len(self.points)},)")


# ------------------------------------------------------------------------------------------------------ trajectories
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
        step_covariances: `(N - 1, 6, 6)` of `relative_pose(n, n + 1)` where the source states them; the drift model is
            then not used.
    """

    robot: str
    stamps_ns: IntArray
    poses: FloatArray
    drift: DriftModel = field(default_factory=DriftModel)
    finer: Trajectory | None = None
    step_covariances: FloatArray | None = None

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
            return AccumulatedSteps.along(self.poses, self.step_covariances)
        return AccumulatedDrift.along(self.poses, self.drift)

    def covers(self, stamps_ns: IntArray, tolerance_ns: int = 0) -> NDArray[np.bool_]:
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
        stated = None
        if self.step_covariances is not None:
            stated = self.relative_covariance(indices[:-1], indices[1:])
        return Trajectory(self.robot, self.stamps_ns[indices], self.poses[indices], self.drift, step_covariances=stated)

    def keyframes(self, indices: IntArray) -> Trajectory:
        """The poses at `indices` (increasing) as keyframes, which remember the poses between."""
        return replace(self.subset(indices), finer=self._known)

    def moved(self, T_new_odom: FloatArray) -> Trajectory:
        """The same trajectory in another frame: poses `T_new_odom @ T_odom_body`."""
        finer = None if self.finer is None else self.finer.moved(T_new_odom)
        poses = T_new_odom @ self.poses
        return Trajectory(self.robot, self.stamps_ns, poses, self.drift, finer, self.step_covariances)

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


@dataclass(frozen=True, slots=True, order=True)
class KeyframeId:
    """Names a keyframe: the robot, and the keyframe's index in that robot's keyframe trajectory."""

    robot: str
    index: int


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """A scan worth remembering.

    Args:
        key: robot and keyframe index.
        stamp_ns: time of the pose.
        T_odom_body: `(4, 4)` pose in the robot's odometry frame.
        cloud: `(N, 3)` float32, deskewed and thinned points in the body's axes.
        descriptor: `(rings, sectors)` scan context.
    """

    key: KeyframeId
    stamp_ns: int
    T_odom_body: FloatArray
    cloud: Float32Array
    descriptor: Float32Array


# ---------------------------------------------------------------------------------------------------------- wireless
@dataclass(frozen=True, slots=True)
class AoaPath:
    """One direction from which a signal arrived: a mode of an angle-of-arrival profile.

    Args:
        azimuth: rad, counter-clockwise from x forward.
        sigma: rad, standard deviation.
        weight: how likely this mode is the direct path, relative to the other modes of the same measurement.
        elevation: rad, up from the horizontal plane, or None where the antenna cannot tell.
    """

    azimuth: float
    sigma: float
    weight: float = 1.0
    elevation: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.azimuth) and math.isfinite(self.sigma) and math.isfinite(self.weight)):
            raise InputError(f"path {self} holds a number that is not finite")
        if self.sigma <= 0:
            raise InputError(f"path sigma is {self.sigma}; it must be > 0 (radians)")
        if self.weight < 0:
            raise InputError(f"path weight is {self.weight}; it must be >= 0")
        if self.elevation is not None and not abs(self.elevation) <= np.pi / 2 + 1e-6:
            raise InputError(f"path elevation is {self.elevation}; it must lie within -pi/2 and pi/2 (radians)")


@dataclass(frozen=True, slots=True)
class WirelessMeasurement:
    """What the receiver learnt from one exchange with the transmitter: a range, directions, or both.

    Args:
        stamp_ns: receiver's time.
        receiver: robot that measured.
        transmitter: robot whose signal was measured.
        range_m: distance between the antennas, or None.
        range_sigma_m: its standard deviation; required with a range.
        paths: directions of arrival; the direct one is at most one of them, and may be missing. Empty: no direction.
        aoa_frame: axes of the directions: `body` (receiver's, at the stamp), `odometry` (receiver's odometry frame) or
            `world` (the axes that `Heading` refers to).
        transmitter_stamp_ns: time at the transmitter, where it differs.
        lever_arm_receiver: `(x, y, z)` of the antenna in the receiver's body frame, metres.
        lever_arm_transmitter: the same at the transmitter.
    """

    stamp_ns: int
    receiver: str
    transmitter: str
    range_m: float | None = None
    range_sigma_m: float | None = None
    paths: tuple[AoaPath, ...] = ()
    aoa_frame: AoaFrame = "body"
    transmitter_stamp_ns: int | None = None
    lever_arm_receiver: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lever_arm_transmitter: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.receiver == self.transmitter:
            raise InputError(f"wireless measurement from {self.receiver!r} to itself")
        if self.range_m is None and not self.paths:
            raise InputError("wireless measurement without range and without paths")
        if self.range_m is not None:
            if not (math.isfinite(self.range_m) and self.range_m >= 0):
                raise InputError(f"range is {self.range_m}; it must be a number >= 0 (metres)")
            if self.range_sigma_m is None or not (math.isfinite(self.range_sigma_m) and self.range_sigma_m > 0):
                raise InputError(f"range_sigma is {self.range_sigma_m}; it must be a number > 0 (metres)")
        if self.aoa_frame not in {"body", "odometry", "world"}:
            raise InputError(f"aoa_frame is {self.aoa_frame!r}; expected body, odometry or world")
        for name in ("lever_arm_receiver", "lever_arm_transmitter"):
            arm = getattr(self, name)
            if len(arm) != 3 or not all(map(math.isfinite, arm)):
                raise InputError(f"{name} is {arm}; expected three finite numbers (metres)")


@dataclass(frozen=True, slots=True)
class Heading:
    """A compass or AHRS reading: yaw of the robot's body in the common world axes, radians."""

    stamp_ns: int
    robot: str
    heading: float
    sigma: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.heading):
            raise InputError(f"heading is {self.heading}; it must be finite (radians)")
        if not (np.isfinite(self.sigma) and self.sigma > 0):
            raise InputError(f"heading sigma is {self.sigma}; it must be a number > 0 (radians)")


@dataclass(frozen=True, slots=True)
class WirelessLog:
    """All that was heard: measurements and headings, each in order of time."""

    measurements: tuple[WirelessMeasurement, ...] = ()
    headings: tuple[Heading, ...] = ()

    def __add__(self, other: Self) -> WirelessLog:
        return WirelessLog(
            tuple(sorted(self.measurements + other.measurements, key=lambda m: m.stamp_ns)),
            tuple(sorted(self.headings + other.headings, key=lambda h: h.stamp_ns)),
        )

    def robots(self) -> set[str]:
        """Names of all robots that occur."""
        return {r for m in self.measurements for r in (m.receiver, m.transmitter)} | {h.robot for h in self.headings}


# -------------------------------------------------------------------------------------------- candidates and closures
class RelativePosePredictor(Protocol):
    """Says where keyframes of two robots are, relative to each other."""

    def relative_poses(
        self, robot_a: str, index_a: IntArray, robot_b: str, index_b: IntArray
    ) -> tuple[FloatArray, FloatArray]:
        """`T_a_b (M, 4, 4)` of the indexed poses, and its covariances `(M, 6, 6)`."""
        ...


class ClosureCheck(Protocol):
    """Holds measured closures of two robots against what a filter knows of them."""

    def objections(
        self, T_a_b: FloatArray, covariance: FloatArray, index_a: IntArray, index_b: IntArray
    ) -> tuple[str, ...]:
        """Why each of N closures cannot be, as a sentence; empty where nothing speaks against it.

        Args:
            T_a_b: `(N, 4, 4)` measured poses of keyframes of b in those of a.
            covariance: `(N, 6, 6)` their covariances.
            index_a: `(N,)` keyframes of a.
            index_b: `(N,)` those of b.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class CandidatePairs:
    """Pairs of keyframes of two robots that may see the same place.

    Args:
        robot_a, robot_b: the robots, a before b in the order of the trajectories.
        index_a, index_b: `(M,)` keyframe indices, sorted by a, then b.
        overlap_probability: `(M,)` in [0, 1]; NaN where the filter predicts nothing.
        mahalanobis: `(M,)` Mahalanobis distance of the pair's displacement (paper, eq. 6); NaN likewise.
        predictor: gives the predicted relative poses; None where the filter predicts nothing.
    """

    robot_a: str
    robot_b: str
    index_a: IntArray
    index_b: IntArray
    overlap_probability: FloatArray
    mahalanobis: FloatArray
    predictor: RelativePosePredictor | None = None

    def __post_init__(self) -> None:
        for name in ("index_b", "overlap_probability", "mahalanobis"):
            if getattr(self, name).shape != self.index_a.shape:
                raise ValueError(
                    f"candidate {name} has shape {getattr(self, name).shape}, index_a {self.index_a.shape}"
                )

    def __len__(self) -> int:
        return len(self.index_a)

    @classmethod
    def without_prediction(cls, robot_a: str, robot_b: str, index_a: IntArray, index_b: IntArray) -> CandidatePairs:
        """Pairs of which nothing more is known."""
        unknown = np.full(len(index_a), np.nan)
        return cls(robot_a, robot_b, index_a, index_b, unknown, unknown)

    def predicted(self, rows: IntArray) -> tuple[FloatArray, FloatArray] | None:
        """Predicted `T_a_b (K, 4, 4)` and covariances `(K, 6, 6)` of the given rows, or None."""
        if self.predictor is None:
            return None
        return self.predictor.relative_poses(self.robot_a, self.index_a[rows], self.robot_b, self.index_b[rows])


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentHypothesis:
    """One way in which two odometry frames may lie: transform, log-likelihood, and the paths it explains.

    Args:
        T_a_b: `(4, 4)`, odometry frame of b in that of a.
        log_likelihood: of all measurements between the robots under this transform.
        paths_kept: `(measurement, path)` indices into the wireless log's measurements; path -1 stands for a measurement
            whose range was used without a direction.
    """

    T_a_b: FloatArray
    log_likelihood: float
    paths_kept: tuple[tuple[int, int], ...]


@dataclass(frozen=True, slots=True, eq=False)
class FrameAlignment:
    """What the radio says of how two robots' odometry frames lie.

    Args:
        robot_a, robot_b: the robots.
        best: most likely alignment, or None where there is none.
        covariance: `(6, 6)` of `best.T_a_b`, or None.
        ambiguous: true where the alignment must not be used to prune.
        reason: one sentence that says why, or what carries the alignment.
        runner_up: the best *different* alignment, or None.
        rivals: where the doubt is between a few clear alignments, those that are likely besides `best`.
        heading_knowledge: `heading`, `reciprocal`, `one-way`, `range-only` or `none`.
    """

    robot_a: str
    robot_b: str
    best: AlignmentHypothesis | None
    covariance: FloatArray | None
    ambiguous: bool
    reason: str
    runner_up: AlignmentHypothesis | None = None
    heading_knowledge: str = "none"
    rivals: tuple[AlignmentHypothesis, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class RadioLinks:
    """What two robots measured of each other and a filter takes for true, ready for a pose graph.

    Args:
        robot_a, robot_b: the robots.
        T_a_b: `(4, 4)` odometry frame of b in that of a, roughly.
        level: `(6, 6)` covariance of what is known of `T_a_b` without these measurements: gravity, and the ground.
        index_a, index_b: `(L,)` keyframes nearest in time.
        antenna_a, antenna_b: `(L, 3)` m, antennas when they measured, in the body axes of these keyframes.
        a_receives: `(L,)` whether a measured b's signal.
        range_m, range_sigma_m: `(L,)`; NaN where nothing was ranged.
        direction: `(L, 3)` unit vector to the transmitter, in the body axes of the receiver's keyframe; NaN where the
            direct path is not known.
        direction_covariance: `(L, 3, 3)` of the direction, on the tangent plane, rad^2.
    """

    robot_a: str
    robot_b: str
    T_a_b: FloatArray
    level: FloatArray
    index_a: IntArray
    index_b: IntArray
    antenna_a: FloatArray
    antenna_b: FloatArray
    a_receives: NDArray[np.bool_]
    range_m: FloatArray
    range_sigma_m: FloatArray
    direction: FloatArray
    direction_covariance: FloatArray

    def __len__(self) -> int:
        return len(self.range_m)


@dataclass(frozen=True, slots=True, eq=False)
class FilterResult:
    """What a candidate filter gives to the pipeline.

    Args:
        filter_name: registry name of the filter.
        pairs: kept pairs, one entry for each pair of robots (also when empty).
        pairs_total: how many pairs of keyframes there are between different robots.
        alignments: one for each pair of robots of which the radio says anything.
        diagnosis: sentences for the user: what was passed, rejected or left out, and why.
        seconds: wall time spent.
        links: measurements that the kept pairs rest on, for the pose graph.
        checks: what measured closures of two robots, by their names, can be held against.
    """

    filter_name: str
    pairs: tuple[CandidatePairs, ...]
    pairs_total: int
    alignments: tuple[FrameAlignment, ...] = ()
    diagnosis: tuple[str, ...] = ()
    seconds: float = 0.0
    links: tuple[RadioLinks, ...] = ()
    checks: Mapping[tuple[str, str], ClosureCheck] = field(default_factory=dict)

    @property
    def pairs_kept(self) -> int:
        """How many pairs passed."""
        return sum(len(p) for p in self.pairs)


class Decision(StrEnum):
    """How far a closure came."""

    PROPOSED = "proposed"
    VERIFIED = "verified"
    ACCEPTED = "accepted"
    REJECTED = "rejected"


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is known of a closure; NaN where a stage did not say.

    Args:
        scan_context_distance: 1 - column cosine at the best shift, in [0, 1].
        scan_context_yaw: rad, yaw of the match's body in the query's body.
        overlap_probability: from the filter.
        prior_chi2: squared Mahalanobis distance of the registration from the filter's prediction.
        inliers: number of matched points after registration, level ground left out.
        inlier_ratio: share of the points that matched, mean over both clouds, level ground left out.
        agreement: share of the points that matched among those that matched or that the other sensor looked through.
        rms_m: root mean square of the distances of matched points.
        consistent_with: how many other closures of the robot pair agree (PCM degree).
        residual_m, residual_rad: distance and angle between the measurement and the final estimate.
    """

    scan_context_distance: float = float("nan")
    scan_context_yaw: float = float("nan")
    overlap_probability: float = float("nan")
    prior_chi2: float = float("nan")
    inliers: int = 0
    inlier_ratio: float = float("nan")
    agreement: float = float("nan")
    rms_m: float = float("nan")
    consistent_with: int = 0
    residual_m: float = float("nan")
    residual_rad: float = float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class Closure:
    """A claim that two keyframes see the same place: the one type that flows from matching to the graph.

    Args:
        query, match: the keyframes.
        T_query_match: `(4, 4)`, match's body in the query's body: a guess while proposed, measured when verified.
        covariance: `(6, 6)` of the measurement.
        evidence: what is known of it.
        decision: how far it came.
        reason: why it was rejected or accepted, one phrase.
    """

    query: KeyframeId
    match: KeyframeId
    T_query_match: FloatArray
    covariance: FloatArray
    evidence: Evidence
    decision: Decision
    reason: str = ""


def robot_pairs(robots: list[str]) -> Iterator[tuple[str, str]]:
    """Every pair of different robots, in order."""
    return ((a, b) for i, a in enumerate(robots) for b in robots[i + 1 :])
