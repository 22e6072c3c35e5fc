"""Initial guesses of registration: it finds the best pose near a start, so it needs a start near the truth."""

from __future__ import annotations

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, Prediction, PredictionKind

REACH_VOXELS = 6.0
REACH_YAW_RAD = 0.3
_UNKNOWN_YAW_RAD = 1.0
_SPREAD = 1.5


def around_scan_context(yaw_rad: float | None, count: int) -> FloatArray:
    """`(count, 4, 4)` starts at scan context's yaw, where there is one, and at equal turns of it, not displaced.

    Scan context's yaw is wrong when the scans were taken some metres apart sideways, so it only comes first.
    """
    first = 0.0 if yaw_rad is None else yaw_rad
    turns = np.linspace(0.0, 2 * np.pi, count, endpoint=False)
    return se3.from_yaw(first + turns, np.zeros((count, 3)))


def around_prediction(prediction: Prediction, scan_context_yaw_rad: float | None, voxel_m: float) -> FloatArray:
    """Starts `(S, 4, 4)` at the predicted pose and, where it is vague, around it.

    One step of 1.5 standard deviations to either side along each direction in which the prediction is vaguer than the
    reach of the coarsest registration: two principal axes of the position, unless only the heading is predicted (scans
    that overlap are best registered from where they are), and the yaw, which is tried all around where it is as good as
    unknown.  Scan context's yaw is tried at the predicted position where the prediction leaves room.
    """
    T_query_match, covariance = prediction.T_query_match, prediction.covariance
    steps = [np.zeros(6)]
    variances, axes = np.linalg.eigh(covariance[3:, 3:])
    for variance, axis in zip(variances[:0:-1], axes.T[:0:-1], strict=True):
        if prediction.kind is PredictionKind.POSE and variance > (REACH_VOXELS * voxel_m) ** 2:
            step = np.concatenate([np.zeros(3), _SPREAD * np.sqrt(variance) * axis])
            steps += [step, -step]
    sigma_yaw_rad = float(np.sqrt(covariance[2, 2]))
    if sigma_yaw_rad > _UNKNOWN_YAW_RAD:
        steps += [_turn(angle) for angle in np.arange(1, 8) * np.pi / 4]
    elif sigma_yaw_rad > REACH_YAW_RAD:
        steps += [_turn(_SPREAD * sigma_yaw_rad), _turn(-_SPREAD * sigma_yaw_rad)]
    if scan_context_yaw_rad is not None:
        turn = scan_context_yaw_rad - float(se3.yaw(T_query_match))
        turn = float(np.arctan2(np.sin(turn), np.cos(turn)))
        if 0.1 < abs(turn) < 3.0 * sigma_yaw_rad + 0.1:
            steps.append(_turn(turn))
    return np.asarray(T_query_match @ se3.exp(np.array(steps)))


def _turn(angle_rad: float) -> FloatArray:
    return np.array([0.0, 0.0, angle_rad, 0.0, 0.0, 0.0])
