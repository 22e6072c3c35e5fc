"""Whose axes ground truth is in: a LiDAR's, a camera's, a motion capture body's, or nobody's.

Positions do not care, but relative poses do: with the axes of a camera every true closure would look wrong.  A body
that is bolted to the LiDAR moves as the LiDAR does, so between two poses the displacement and the rotation vector, each
seen in the body's own axes, are the LiDAR's turned by one constant rotation.  It is found from all steps at once
(Wahba's problem): a vehicle that only drives ahead and steers determines it, for the one vector points ahead and the
other upwards.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from wiclosure import se3
from wiclosure.pipeline.evaluation.errors import Matched, best_rotation, matched
from wiclosure.types import FloatArray, Trajectory

STEP_M = 1.5  # long enough to tell a direction, short enough that odometry does not drift
FEWEST_STEPS = 8
SIGMA_M, SIGMA_RAD = 0.02, 0.01  # errors of a step: the relative weight of displacements and rotations
SAME_AXES_DEG = 10.0  # less is calibration, and left as it is
CERTAIN_DEG = 2.0  # standard deviation up to which the rotation is used
_MISFIT = (
    0.3  # share of the displacements that may stay unexplained: more, and one of the two does not follow the robot
)


@dataclass(frozen=True, slots=True)
class OrientedTruth:
    """Ground truth whose orientations can be compared with the estimate's.

    Args:
        truth: by robot, in the LiDAR's axes; positions as they were.
        unoriented: robots whose orientations mean nothing.
        remarks: sentences for the user.
    """

    truth: Mapping[str, Trajectory]
    unoriented: frozenset[str]
    remarks: tuple[str, ...]

    @property
    def oriented(self) -> dict[str, Trajectory]:
        """Ground truth of those robots alone whose orientations mean something."""
        return {robot: truth for robot, truth in self.truth.items() if robot not in self.unoriented}


def in_lidar_axes(estimates: Mapping[str, Trajectory], truth: Mapping[str, Trajectory], gap_s: float) -> OrientedTruth:
    """Ground truth, turned where it is of a body with other axes than the LiDAR's.

    Args:
        estimates: `T_world_body` by robot, in the LiDAR's axes.
        truth: ground truth by robot, as far as there is any.
        gap_s: how near ground truth must be in time.
    """
    turned, unoriented, remarks = dict(truth), set(), []
    for robot in [robot for robot in estimates if robot in truth]:
        pair = matched(estimates[robot], truth[robot], gap_s)
        if _says_nothing(pair):
            unoriented.add(robot)
            remarks.append(f"ground truth of {robot} has no orientations: only errors of positions are given there")
            continue
        found = body_rotation(pair)
        if found is None:
            continue
        R_truth_lidar, certain = found
        degrees = np.degrees(np.arccos(np.clip((np.trace(R_truth_lidar) - 1) / 2, -1.0, 1.0)))
        if not certain:
            unoriented.add(robot)
            remarks.append(
                f"ground truth of {robot} is of a body with other axes than the LiDAR's, and the path turns too little"
                " to tell which: only errors of positions are given there"
            )
        elif degrees > SAME_AXES_DEG:
            T_truth_lidar = se3.from_rotation_translation(R_truth_lidar, np.zeros(3))
            turned[robot] = replace(truth[robot], poses=truth[robot].poses @ T_truth_lidar, finer=None)
            remarks.append(
                f"ground truth of {robot} is of a body turned by {degrees:.0f} degrees against the LiDAR;"
                " taken into account"
            )
    return OrientedTruth(turned, frozenset(unoriented), tuple(remarks))


def body_rotation(robot: Matched) -> tuple[FloatArray, bool] | None:
    """`R_truth_lidar (3, 3)` between the axes of ground truth's body and the LiDAR's, and whether it is certain.

    None where the steps do not tell whether there is any: too few, or not alike.  Not certain where the displacements
    tell that there is one, but leave open a rotation about them.
    """
    moved_truth, moved = _alike(*_steps(robot.truth, robot.estimate, "displacement"), 0.1)
    turned_truth, turned = _alike(*_steps(robot.truth, robot.estimate, "rotation"), 0.05)
    if len(moved) < FEWEST_STEPS:
        return None
    target = np.concatenate([moved_truth / SIGMA_M, turned_truth / SIGMA_RAD])
    source = np.concatenate([moved / SIGMA_M, turned / SIGMA_RAD])
    R = best_rotation(target.T @ source)
    size = np.linalg.norm(moved)
    if np.linalg.norm(moved_truth - moved @ R.T) > _MISFIT * size:
        return None
    if _sigma_deg(target, source @ R.T) < CERTAIN_DEG:
        return R, True
    apart = np.linalg.norm(moved_truth - moved) / size
    return (R, False) if apart > 2 * np.sin(np.radians(SAME_AXES_DEG) / 2) else None


def _says_nothing(robot: Matched) -> bool:
    """Whether ground truth never turns although the robot does."""
    if len(robot) < 2:
        return False
    still, seen = (se3.rotation_angle(se3.between(poses[:1], poses)).max() for poses in (robot.truth, robot.estimate))
    return bool(still < 1e-4 and seen > np.radians(SAME_AXES_DEG))


def _steps(truth: FloatArray, estimate: FloatArray, what: str) -> tuple[FloatArray, FloatArray]:
    """Displacements or rotation vectors `(N, 3)` of both over the same steps, each in its own body's axes."""
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))])
    ends = np.unique(np.floor(travelled[: len(truth)] / STEP_M), return_index=True)[1]
    steps = [se3.between(poses[ends[:-1]], poses[ends[1:]]) for poses in (truth, estimate)]
    first, second = ((T[:, :3, 3] if what == "displacement" else se3.log(T)[:, :3]) for T in steps)
    return first, second


def _alike(truth: FloatArray, estimate: FloatArray, slack: float) -> tuple[FloatArray, FloatArray]:
    """The vectors whose lengths agree, which no rotation changes: the others are gaps, jumps or slips."""
    length_truth, length = np.linalg.norm(truth, axis=1), np.linalg.norm(estimate, axis=1)
    alike = np.abs(length_truth - length) <= 0.2 * length + slack
    return truth[alike], estimate[alike]


def _sigma_deg(target: FloatArray, source: FloatArray) -> float:
    """Largest standard deviation, over all axes, of the rotation between vectors in units of their errors.

    From the curvature of the cost, and from how much the vectors really disagree about its minimum, so that rotation
    vectors which are nothing but noise do not pass for a rotation however many there are.
    """
    correlation = target.T @ source
    curvature = np.trace(correlation) * np.eye(3) - (correlation + correlation.T) / 2
    if np.linalg.eigvalsh(curvature)[0] <= 1e-9 * max(np.trace(curvature), 1e-9):
        return float("inf")
    pulls = np.cross(source, target)
    inverse = np.linalg.inv(curvature)
    covariance = inverse + inverse @ (pulls.T @ pulls) @ inverse
    return float(np.degrees(np.sqrt(np.linalg.eigvalsh(covariance)[-1])))
