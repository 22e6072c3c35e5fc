"""Least squares over relative poses by GTSAM: its Cholesky factors take a fraction of the time of a general LU."""

from __future__ import annotations

import logging

import gtsam
import numpy as np

from wiclosure.backends.least_squares.normal_matrix import HELD
from wiclosure.types import FloatArray, IntArray

logger = logging.getLogger(__name__)


def descended(
    first: IntArray, second: IntArray, T: FloatArray, W: FloatArray, poses: FloatArray, held: IntArray
) -> FloatArray:
    """Poses `(N, 4, 4)` of least cost near those given; these themselves where the system is indeterminate.

    Args:
        first: `(M,)` nodes.
        second: `(M,)` likewise.
        T: `(M, 4, 4)` measured poses of the second in the first.
        W: `(M, 6, 6)` whiteners of the errors in the second's body.
        poses: where to begin.
        held: nodes that do not move.
    """
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    whitened, tight = gtsam.noiseModel.Gaussian.SqrtInformation, gtsam.noiseModel.Isotropic.Precision(6, HELD)
    for i, j, T_ij, W_ij in zip(first.tolist(), second.tolist(), T, W, strict=True):
        graph.add(gtsam.BetweenFactorPose3(i, j, gtsam.Pose3(T_ij), whitened(W_ij, False)))
    for n in held.tolist():
        graph.add(gtsam.PriorFactorPose3(n, gtsam.Pose3(poses[n]), tight))
    nodes = np.unique(np.concatenate([first, second, held])).tolist()
    for n in nodes:
        values.insert(n, gtsam.Pose3(poses[n]))
    try:
        solved = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    except RuntimeError:  # GTSAM's own, thrown for indeterminate systems
        logger.debug("Levenberg-Marquardt failed", exc_info=True)
        return poses
    moved = poses.copy()
    moved[nodes] = np.stack([solved.atPose3(n).matrix() for n in nodes])
    return moved if np.isfinite(moved).all() else poses
