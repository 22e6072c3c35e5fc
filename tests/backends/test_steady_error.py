"""Odometry without a constant error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.backends.steady_error import SteadyError, chained
from wiclosure.types import Trajectory

PER_M = np.array([0.0, 0.0, 0.004, 0.02, 0.0, 0.0])


@pytest.fixture
def path():
    """Steps of a metre, turning this way and that."""
    turns = np.random.default_rng(1).normal(0, 0.2, 40)
    steps = se3.from_yaw(turns, np.tile([1.0, 0.0, 0.0], (40, 1)))
    poses = chained(np.concatenate([se3.from_yaw(0.3, np.array([5.0, 2.0, 1.0]))[None], steps]))
    return Trajectory("alpha", np.arange(41) * 10**9, poses)


def test_the_products_of_steps_are_those_of_one_after_another(path):
    expected = path.poses[0]
    steps = se3.between(path.poses[:-1], path.poses[1:])
    for step, pose in zip(steps, path.poses[1:], strict=True):
        expected = expected @ step
        np.testing.assert_allclose(pose, expected, atol=1e-12)


def test_what_a_constant_error_did_is_undone(path):
    steps = se3.between(path.poses[:-1], path.poses[1:])
    erring = replace(path, poses=chained(np.concatenate([path.poses[:1], steps @ se3.exp(-PER_M)])))
    # Metres are counted by odometry, which errs by a fiftieth.
    found = SteadyError("alpha", PER_M / np.mean(np.diff(erring.distance))).corrected(erring)
    assert np.linalg.norm(erring.positions[-1] - path.positions[-1]) > 1.0
    np.testing.assert_allclose(found.poses, path.poses, atol=0.01)


def test_poses_between_keyframes_go_with_the_one_before(path):
    keyframes = path.keyframes(np.arange(0, 41, 4))
    found = SteadyError("alpha", PER_M).corrected(keyframes)
    np.testing.assert_allclose(found.at(keyframes.stamps_ns), found.poses, atol=1e-12)
    np.testing.assert_allclose(
        se3.between(found.poses[3], found.at(path.stamps_ns[13:14])[0]), se3.between(path.poses[12], path.poses[13])
    )


def test_the_sentence_names_what_is_wrong():
    assert "errs steadily, by 0.23 degrees and 2 cm in each metre" in SteadyError("alpha", PER_M).sentence
    assert "by 2 cm in each metre" in SteadyError("alpha", PER_M * [0, 0, 0, 1, 1, 1]).sentence


@pytest.mark.parametrize(("metres", "plausible"), [(0.02, True), (0.5, True), (0.6, False), (-0.9, False)])
def test_an_error_of_more_than_half_of_the_motion_is_not_plausible(metres, plausible):
    error = SteadyError("alpha", np.array([0.0, 0.0, 1.0, metres, 0.0, 0.0]))
    assert error.plausible == plausible
    assert f"the odometry of alpha errs by 57 degrees and {abs(100 * metres):.2g} cm in each metre" in error.doubt
