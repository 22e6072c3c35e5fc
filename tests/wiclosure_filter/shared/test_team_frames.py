"""Odometry frames of a team from alignments of pairs."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, FrameAlignment
from wiclosure.wiclosure_filter.shared.team_frames import frames_from, settled

FRAMES = {"a": np.eye(4), "b": se3.from_yaw(0.9, np.array([10.0, 4.0, 0.0])), "c": se3.from_yaw(-1, np.ones(3))}


def aligned(a: str, b: str, off_m: float = 0.0, variance: float = 1.0) -> FrameAlignment:
    off = se3.from_yaw(0.0, np.array([off_m, 0.0, 0.0]))
    hypothesis = AlignmentHypothesis(se3.between(FRAMES[a], FRAMES[b]) @ off, 0.0, ())
    return FrameAlignment(a, b, hypothesis, variance * np.eye(6), False, "made for a test")


@pytest.mark.parametrize(
    ("pairs", "joined"),
    [
        ([("a", "b"), ("b", "c")], ["a", "b", "c"]),
        ([("b", "c"), ("a", "c")], ["a", "b", "c"]),
        ([("b", "c")], ["a"]),
        ([], ["a"]),
    ],
)
def test_frames_are_joined_along_any_chain(pairs: list[tuple[str, str]], joined: list[str]) -> None:
    frames = frames_from(["a", "b", "c"], [aligned(*pair) for pair in pairs])
    assert list(frames) == joined
    for robot, T_world_odom in frames.items():
        np.testing.assert_allclose(T_world_odom, FRAMES[robot], atol=1e-12)


def test_along_a_chain_nothing_is_to_settle() -> None:
    alignments = [aligned("a", "b", off_m=1.0), aligned("b", "c")]
    frames = frames_from(list(FRAMES), alignments)
    for robot, T_world_odom in settled(frames, alignments, 2.385).items():
        np.testing.assert_array_equal(T_world_odom, frames[robot])


def test_a_cycle_that_does_not_close_is_shared_out() -> None:
    """The chain alone has b a metre off; three alignments that err alike share the metre evenly."""
    alignments = [aligned("a", "b", off_m=1.0), aligned("b", "c"), aligned("a", "c")]
    frames = frames_from(list(FRAMES), alignments)
    found = settled(frames, alignments, 100.0)
    np.testing.assert_allclose(found["a"], np.eye(4), atol=1e-6)
    before, after = (
        [float(np.linalg.norm(T[robot][:3, 3] - FRAMES[robot][:3, 3])) for robot in ("b", "c")] for T in (frames, found)
    )
    assert max(after) < 0.95 * max(before)
    assert sum(after) < 0.75 * sum(before)
    # the precise ones win
    alignments = [aligned("a", "b", off_m=1.0, variance=1e4), aligned("b", "c"), aligned("a", "c")]
    found = settled(frames, alignments, 100.0)
    for robot, T_world_odom in found.items():
        np.testing.assert_allclose(T_world_odom, FRAMES[robot], atol=2e-2)
