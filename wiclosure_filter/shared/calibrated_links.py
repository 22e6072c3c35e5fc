"""Kept links without the systematic errors that were estimated, and what these leave open of the joint estimate."""

from __future__ import annotations

from dataclasses import replace

import gtsam
import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment, IntArray, Trajectory
from wiclosure.wiclosure_filter.alignment.calibration import (
    AZIMUTH_A,
    AZIMUTH_B,
    BIAS,
    CLOCK,
    COUNT,
    RANGE_SCALE,
    motion,
)
from wiclosure.wiclosure_filter.shared.joint_factors import add_links
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

_OF_LINKS = (BIAS, RANGE_SCALE, CLOCK, AZIMUTH_A, AZIMUTH_B)  # scales of odometry are for the drift to follow
_STEP = 0.1  # of a standard deviation, where derivatives are taken


def errors_of(alignment: FrameAlignment) -> tuple[FloatArray, FloatArray]:
    """Values `(7,)` and covariance `(7, 7)` of the errors that an alignment estimated; nothing where it did not."""
    if alignment.calibration_covariance is None:
        return np.zeros(COUNT), np.zeros((COUNT, COUNT))
    return np.array([one.value for one in alignment.calibration]), alignment.calibration_covariance


def without_errors(kept: KeptLinks, errors: FloatArray, b: Trajectory) -> KeptLinks:
    """The links as they would be without errors `(7,)`; `b` is the trajectory of the second robot."""
    links = kept.links
    turn = -np.where(links.a_receives, errors[AZIMUTH_A], errors[AZIMUTH_B])
    R = se3.from_yaw(turn, np.zeros((len(turn), 3)))[:, :3, :3]
    moved = errors[CLOCK] * motion(b, links.index_b)[0]
    in_keyframe = np.einsum("lji,lj->li", b.poses[links.index_b, :3, :3], moved)
    corrected = replace(
        links,
        range_m=np.maximum(links.range_m - errors[BIAS], 0.0) / (1 + errors[RANGE_SCALE]),
        antenna_b=links.antenna_b + moved,
        antenna_keyframe_b=links.antenna_keyframe_b + in_keyframe,
    )
    return KeptLinks(
        corrected,
        np.einsum("lij,lj->li", R, kept.direction),
        R @ kept.direction_covariance @ np.swapaxes(R, 1, 2),
    )


def pulls(
    kept: KeptLinks,
    covariance: FloatArray,
    keys: tuple[IntArray, IntArray],
    b: Trajectory,
    values: gtsam.Values,
    robust_threshold: float,
) -> dict[int, FloatArray]:
    """How errors would pull at the nodes of the links, as independent ones of one standard deviation each.

    Args:
        kept: L links.
        covariance: `(7, 7)` of the errors.
        keys: `(L,)` each, of the nodes at a and at b.
        b: trajectory of the second robot.
        values: the joint estimate.
        robust_threshold: of the kernel, in standard deviations.

    Returns:
        By key of a node, change of the gradient `(6, 5)`.
    """
    of_links = covariance[np.ix_(_OF_LINKS, _OF_LINKS)]
    sigma = np.sqrt(np.diag(of_links))
    mixing = np.linalg.cholesky(of_links / np.outer(sigma, sigma) + 1e-9 * np.eye(len(sigma)))
    still = _gradient(kept, keys, values, robust_threshold)
    found = {key: np.zeros((6, len(_OF_LINKS))) for key in still}
    for column, error in enumerate(_OF_LINKS):
        step = np.zeros(COUNT)
        step[error] = _STEP * sigma[column]
        moved = values
        if error == CLOCK:
            moved = _moved(values, keys[1], step[CLOCK] * motion(b, kept.links.index_b)[0])
        changed = _gradient(without_errors(kept, step, b), keys, moved, robust_threshold)
        for key, gradient in changed.items():
            found[key][:, column] = (gradient - still[key]) / _STEP
    return {key: pull @ mixing for key, pull in found.items()}


def _gradient(
    kept: KeptLinks, keys: tuple[IntArray, IntArray], values: gtsam.Values, robust_threshold: float
) -> dict[int, FloatArray]:
    graph = gtsam.NonlinearFactorGraph()
    add_links(graph, kept, *keys, robust_threshold)
    gradient = graph.linearize(values).gradientAtZero()
    return {key: gradient.at(key) for key in np.unique(np.concatenate(keys)).tolist() if gradient.exists(key)}


def _moved(values: gtsam.Values, keys: IntArray, by: FloatArray) -> gtsam.Values:
    """Nodes shifted by `(L, 3)` metres in their own axes."""
    moved = gtsam.Values(values)
    for key, shift in dict(zip(keys.tolist(), by, strict=True)).items():
        moved.update(key, values.atPose3(key).compose(gtsam.Pose3(gtsam.Rot3(), shift)))
    return moved
