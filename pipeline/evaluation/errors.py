"""Errors of trajectories against ground truth: absolute, relative, and between robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wiclosure import se3
from wiclosure.pipeline.evaluation.metrics import RelativeErrorMetrics
from wiclosure.types import FloatArray, Trajectory

ORIENTATION_LEVER_M = 1.0  # length at which an orientation weighs as much as a position in `T_truth_estimate`


@dataclass(frozen=True, eq=False)
class Matched:
    """The poses of one robot that have ground truth.

    Args:
        robot: its name.
        estimate: `(N, 4, 4)` `T_world_body` of the run.
        truth: `(N, 4, 4)` `T_truth_body` at the same stamps.
        oriented: whether ground truth's orientations mean anything; without them relative poses cannot be compared.
    """

    robot: str
    estimate: FloatArray
    truth: FloatArray
    oriented: bool = True

    def __len__(self) -> int:
        return len(self.estimate)


def truth_at(truth: Trajectory | None, stamps_ns: np.ndarray, gap_s: float) -> tuple[FloatArray, np.ndarray]:
    """Ground-truth poses `(N, 4, 4)` interpolated at stamps, and which of them `(N,)` it really covers.

    A stamp is covered if ground truth has one no further than `gap_s` before and one no further after.  Beyond the ends
    half a step of ground truth is granted: stamps are rounded.
    """
    if truth is None:
        return np.broadcast_to(np.eye(4), (len(stamps_ns), 4, 4)), np.zeros(len(stamps_ns), bool)
    before = np.searchsorted(truth.stamps_ns, stamps_ns, side="right") - 1
    after = np.searchsorted(truth.stamps_ns, stamps_ns, side="left")
    tolerance_ns = round(min(float(np.median(np.diff(truth.stamps_ns))) / 2, gap_s * 1e9)) if len(truth) > 1 else 0
    inside = truth.covers(stamps_ns, tolerance_ns)
    gap_ns = round(gap_s * 1e9)
    near_before = stamps_ns - truth.stamps_ns[np.maximum(before, 0)] <= gap_ns
    near_after = truth.stamps_ns[np.minimum(after, len(truth) - 1)] - stamps_ns <= gap_ns
    return truth.at_or_beyond(stamps_ns), inside & near_before & near_after


def matched(trajectory: Trajectory, truth: Trajectory | None, gap_s: float) -> Matched:
    """The poses of a trajectory that ground truth covers."""
    poses, covered = truth_at(truth, trajectory.stamps_ns, gap_s)
    return Matched(trajectory.robot, trajectory.poses[covered], poses[covered])


def rigid_alignment(source: FloatArray, target: FloatArray) -> FloatArray:
    """`T_target_source (4, 4)` that brings points `(N, 3)` nearest to their partners; rotation and translation only.

    Umeyama, PAMI 1991, without the scale: a LiDAR knows it.
    """
    centre_source, centre_target = source.mean(axis=0), target.mean(axis=0)
    return _from_correlation((target - centre_target).T @ (source - centre_source), centre_source, centre_target)


def best_rotation(correlation: FloatArray) -> FloatArray:
    """The proper rotation `R (3, 3)` that maximises `trace(R^T correlation)`: Wahba's problem."""
    U, _, Vt = np.linalg.svd(correlation)
    return np.asarray(U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt)


def rms(errors: FloatArray) -> float | None:
    """Root mean square of errors `(N,)`, or of the lengths of error vectors `(N, D)`; None of nothing."""
    return float(np.sqrt(np.sum(np.square(errors)) / len(errors))) if len(errors) else None


def joint_errors(robots: Sequence[Matched]) -> dict[str, FloatArray]:
    """Position errors `(N, 3)` of each robot under *one* alignment of all, so that errors between robots show.

    In the axes of the estimates' world, in which z is up as the first robot's LiDAR first saw it, whatever the axes of
    ground truth are.
    """
    robots = [robot for robot in robots if len(robot)]
    if not robots:
        return {}
    estimate = np.concatenate([robot.estimate for robot in robots])
    truth = np.concatenate([robot.truth for robot in robots])
    T_estimate_truth = rigid_alignment(truth[:, :3, 3], estimate[:, :3, 3])
    return {r.robot: r.estimate[:, :3, 3] - se3.transform(T_estimate_truth, r.truth[:, :3, 3]) for r in robots}


def inter_robot_error(a: Matched, b: Matched) -> tuple[float, float] | None:
    """How far (m) and how much turned (degrees) b's trajectory lies from where a's says it should.

    Both are aligned to ground truth separately; the difference of the alignments is taken at the middle of b's path.
    None without ground truth or its orientations.
    """
    if not (len(a) and len(b) and a.oriented and b.oriented):
        return None
    T_b_b = se3.between(T_truth_estimate(a), T_truth_estimate(b))  # identity if both lie right relative to each other
    middle = b.estimate[:, :3, 3].mean(axis=0)
    moved = T_b_b[:3, :3] @ middle + T_b_b[:3, 3]
    return float(np.linalg.norm(moved - middle)), float(np.degrees(se3.rotation_angle(T_b_b)))


def T_truth_estimate(robot: Matched) -> FloatArray:
    """Alignment of one robot by positions and orientations, so that a straight path too has one answer."""
    position, true_position = robot.estimate[:, :3, 3], robot.truth[:, :3, 3]
    centre, true_centre = position.mean(axis=0), true_position.mean(axis=0)
    correlation = (true_position - true_centre).T @ (position - centre)
    correlation += ORIENTATION_LEVER_M**2 * np.einsum("nij,nkj->ik", robot.truth[:, :3, :3], robot.estimate[:, :3, :3])
    return _from_correlation(correlation, centre, true_centre)


def relative_errors(robot: Matched, distance_m: float) -> RelativeErrorMetrics:
    """Relative pose errors from each pose to the next, and to the first one `distance_m` of true path further on.

    None where ground truth has no orientations: what lies ahead is not known then.
    """
    n = len(robot) if robot.oriented else 0
    steps = np.linalg.norm(np.diff(robot.truth[:n, :3, 3], axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])[:n]
    step_m, step_deg = _relative(robot, np.arange(max(n - 1, 0)), np.arange(1, n))
    ends = np.searchsorted(travelled, travelled + distance_m)
    starts = np.flatnonzero(ends < n)
    far_m, far_deg = _relative(robot, starts, ends[starts])
    covered = travelled[ends[starts]] - travelled[starts]
    percent = 100 * float(np.mean(far_m / covered)) if len(starts) else None
    return {
        "step_m": rms(step_m),
        "step_deg": rms(step_deg),
        "distance_m": distance_m,
        "translation_m": rms(far_m),
        "rotation_deg": rms(far_deg),
        "translation_percent": percent,
    }


def _relative(robot: Matched, i: np.ndarray, j: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Errors in m and degrees of the relative poses from i to j."""
    truth = se3.between(robot.truth[i], robot.truth[j])
    error = se3.between(truth, se3.between(robot.estimate[i], robot.estimate[j]))
    return np.linalg.norm(error[:, :3, 3], axis=1), np.degrees(se3.rotation_angle(error))


def _from_correlation(correlation: FloatArray, centre_source: FloatArray, centre_target: FloatArray) -> FloatArray:
    """The rotation that `best_rotation` gives, and the translation that joins the centres."""
    R = best_rotation(correlation)
    return se3.from_rotation_translation(R, centre_target - R @ centre_source)
