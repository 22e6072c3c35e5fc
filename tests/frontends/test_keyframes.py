from __future__ import annotations

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from wiclosure import se3
from wiclosure.frontends.config import KeyframeSettings
from wiclosure.frontends.keyframes import KeyframeSelector, thinned

STEP = st.tuples(st.floats(0, 0.8), st.floats(-0.15, 0.15))


@given(steps=st.lists(STEP, min_size=1, max_size=60))
@settings(max_examples=40, deadline=None)
def test_neither_gap_between_keyframes_reaches_both_limits_unnoticed(steps: list[tuple[float, float]]) -> None:
    """No pose strays from the keyframe before it by the limits, and no keyframe is nearer than one of them."""
    limits = KeyframeSettings(distance_m=1.0, rotation_rad=0.2)
    selector = KeyframeSelector(limits)
    pose, last = np.eye(4), np.eye(4)
    assert selector.select(pose)
    for forward, turn in steps:
        pose = pose @ se3.from_yaw(turn, np.array([forward, 0.0, 0.0]))
        gap = se3.between(last, pose)
        # On the very edge, rounding decides.
        assume(abs(np.linalg.norm(gap[:3, 3]) - 1.0) > 1e-9)
        assume(abs(abs(se3.yaw(gap)) - 0.2) > 1e-9)
        far = np.linalg.norm(gap[:3, 3]) >= 1.0 or abs(se3.yaw(gap)) >= 0.2
        assert selector.select(pose) == far
        last = pose if far else last


@given(seed=st.integers(0, 100), voxel=st.sampled_from([0.25, 0.5, 1.0]))
@settings(max_examples=20, deadline=None)
def test_thinning_leaves_one_point_a_voxel_near_the_points_it_stands_for(seed: int, voxel: float) -> None:
    points = np.random.default_rng(seed).uniform(-5, 5, (2000, 3))
    few = thinned(points, voxel)
    assert few.dtype == np.float32
    assert len(few) == len(np.unique(np.floor(points / voxel), axis=0))
    np.testing.assert_allclose(np.unique(np.floor(few / voxel), axis=0), np.unique(np.floor(points / voxel), axis=0))


def test_no_points_thin_to_no_points() -> None:
    assert thinned(np.zeros((0, 3)), 0.5).shape == (0, 3)
