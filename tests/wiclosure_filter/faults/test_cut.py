"""Where links and trajectories are cut."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.alignment.align import align
from wiclosure.wiclosure_filter.faults.cut import gain_of_cut, sides

CARRIED = se3.from_yaw(0.6, np.array([25.0, -12.0, 0.0]))


def carried(poses: FloatArray) -> FloatArray:
    half = len(poses) // 2
    return np.concatenate([poses[:half], poses[half] @ CARRIED @ se3.inverse(poses[half]) @ poses[half:]])


def test_each_link_is_on_one_side_and_each_keyframe_on_one_or_both(make_case: Callable[..., object]) -> None:
    case = make_case(heard=20)
    stamps = np.sort(case.links.stamp_a_ns)
    bent = replace(align(case.links, case.trajectories, case.settings), bent_ns=(int(stamps[7]), int(stamps[8])))
    before, after = sides(case.links, bent, case.trajectories)
    assert len(before.links) + len(after.links) == len(case.links)
    assert before.links.stamp_a_ns.max() < after.links.stamp_a_ns.min()
    size = len(case.trajectories["b"])
    early, late = (side.stretch("b", case.trajectories) for side in (before, after))
    assert early["a"] == late["a"] == range(len(case.trajectories["a"]))
    assert early["b"].start == 0
    assert late["b"].stop == size
    assert late["b"].start < early["b"].stop  # between the last link before and the first after, it may be either
    assert before.links.index_b.max() < early["b"].stop
    assert after.links.index_b.min() >= late["b"].start


def test_a_cut_explains_more_only_where_a_robot_was_carried(make_case: Callable[..., object]) -> None:
    for change, explains in ((carried, True), (lambda poses: poses, False)):
        case = make_case(heard=40, false_paths=1, odometry_of_b=change)
        stamps = np.sort(case.links.stamp_a_ns)
        half_ns = int(case.trajectories["b"].stamps_ns[len(case.trajectories["b"]) // 2])
        at = int(np.searchsorted(stamps, half_ns))
        claimed = align(case.links, case.trajectories, case.settings)
        bent = replace(claimed, bent_ns=(int(stamps[at - 1]), int(stamps[at])))
        gain = gain_of_cut(bent, claimed, case.links, case.trajectories, case.settings)
        assert (gain > np.log(1000.0)) == explains
