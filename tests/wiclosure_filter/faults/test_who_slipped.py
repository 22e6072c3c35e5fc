"""A third robot, or a jump of its own odometry, tells who slipped."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import FilterResult, Trajectory
from wiclosure.wiclosure_filter.faults.who_slipped import jump
from wiclosure.wiclosure_filter.filter import WiClosureFilter

from .test_diagnosis import heard, team

AT = 40
CARRIED = se3.from_yaw(0.6, np.array([25.0, -12.0, 0.0]))


def carried(poses: np.ndarray) -> np.ndarray:
    """Moved at one pose, from which on it goes on as before."""
    return np.concatenate([poses[:AT], poses[AT] @ CARRIED @ se3.inverse(poses[AT]) @ poses[AT:]])


def filtered(robots: str, slipped: str, *, seen: bool) -> FilterResult:
    """By odometry that jumps, or by one that notices nothing of the move."""
    odometry, truth = team(robots)
    if seen:
        odometry[slipped] = replace(odometry[slipped], poses=carried(odometry[slipped].poses))
    else:
        truth[slipped] = carried(truth[slipped])
    return WiClosureFilter().candidates(odometry, heard(truth))


@pytest.mark.parametrize("slipped", ["a", "b"])
def test_odometry_that_jumps_names_its_robot(slipped: str) -> None:
    (alignment,) = filtered("ab", slipped, seen=True).alignments
    assert alignment.slipped_robot == slipped
    assert f"it was {slipped}: its odometry jumps at" in alignment.reason


def test_two_robots_do_not_tell_who_was_carried() -> None:
    (alignment,) = filtered("ab", "b", seen=False).alignments
    assert alignment.slipped
    assert alignment.slipped_robot == ""


def test_a_third_robot_tells_who_was_carried() -> None:
    named = {
        (one.robot_a, one.robot_b): one.slipped_robot
        for one in filtered("abc", "b", seen=False).alignments
        if one.slipped
    }
    assert named
    assert set(named.values()) == {"b"}
    assert all("b" in pair for pair in named)


def test_only_a_single_step_within_the_time_is_a_jump() -> None:
    stamps_ns = np.arange(10, dtype=np.int64) * 10**9
    x = np.arange(10.0)
    x[5:] += 4.0
    leap = Trajectory("a", stamps_ns, se3.from_yaw(np.zeros(10), np.column_stack([x, 0 * x, 0 * x])))
    assert "jumps at 5.0 m/s, and is no faster than 1.0 m/s" in jump(leap, (4 * 10**9, 5 * 10**9))
    assert jump(leap, (6 * 10**9, 8 * 10**9)) == ""
    uneven_ns = stamps_ns + 9 * 10**8 * (np.arange(10) == 4)
    evenly = Trajectory("a", uneven_ns, se3.from_yaw(np.zeros(10), np.column_stack([np.arange(10.0), 0 * x, 0 * x])))
    assert jump(evenly, (4 * 10**9, 5 * 10**9)) == ""
    faster = np.concatenate([np.arange(5.0), 4.0 + 5.0 * np.arange(1, 6)])
    drives = Trajectory("a", stamps_ns, se3.from_yaw(np.zeros(10), np.column_stack([faster, 0 * x, 0 * x])))
    assert jump(drives, (4 * 10**9, 5 * 10**9)) == ""
