"""Slips and reflections that stay are told from noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray, FrameAlignment
from wiclosure.wiclosure_filter.alignment.align import align

SLIPPED = se3.from_yaw(0.6, np.array([12.0, -9.0, 0.0]))


def slipping(poses: FloatArray) -> FloatArray:
    half = len(poses) // 2
    return np.concatenate([poses[:half], poses[half] @ SLIPPED @ se3.inverse(poses[half]) @ poses[half:]])


def aligned(case: object) -> FrameAlignment:
    return align(case.links, case.trajectories, case.settings)


def test_a_robot_that_was_moved_is_noticed(make_case: Callable[..., object]) -> None:
    alignment = aligned(make_case(heard=40, false_paths=1, odometry_of_b=slipping))
    assert alignment.ambiguous
    assert alignment.suspected_fault


def test_honest_multipath_is_no_second_alignment(make_case: Callable[..., object]) -> None:
    for seed in range(6):
        alignment = aligned(make_case(heard=30, false_paths=3, seed=seed))
        assert not alignment.ambiguous, alignment.reason
        assert not alignment.suspected_fault
