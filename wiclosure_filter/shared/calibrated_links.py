"""Links without the constant errors that were estimated of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, Trajectory
from wiclosure.wiclosure_filter.drift.calibration import AZIMUTH_A, AZIMUTH_B, BIAS, CLOCK, RANGE_SCALE, motion
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks


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
