from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.pipeline.sources.poses.frames import OneFrame, StaticTransforms, frame_name, matrix
from wiclosure.types import Scan


def transform(translation, quat_xyzw):
    return SimpleNamespace(
        translation=SimpleNamespace(**dict(zip("xyz", translation, strict=True))),
        rotation=SimpleNamespace(**dict(zip("xyzw", quat_xyzw, strict=True))),
    )


@given(seed=st.integers(0, 2**32 - 1))
def test_any_chain_of_frames_is_composed_in_both_directions(seed):
    rng = np.random.default_rng(seed)
    rotations = Rotation.random(4, rng=rng).as_matrix()
    T = se3.from_rotation_translation(rotations, rng.normal(0, 3, (4, 3)))
    graph = StaticTransforms(
        {("base", "mast"): T[0], ("mast", "lidar"): T[1], ("base", "imu"): T[2], ("elsewhere", "lone"): T[3]}
    )
    np.testing.assert_allclose(graph.between("base", "lidar"), T[0] @ T[1], atol=1e-12)
    np.testing.assert_allclose(graph.between("lidar", "imu"), se3.inverse(T[0] @ T[1]) @ T[2], atol=1e-12)
    np.testing.assert_array_equal(graph.between("mast", "mast"), np.eye(4))
    assert graph.between("base", "lone") is None
    np.testing.assert_allclose(graph.between("/base", "/lidar"), T[0] @ T[1], atol=1e-12)


def test_a_message_is_a_matrix_unless_its_numbers_are_none():
    found = matrix(transform([1.0, 2.0, 3.0], [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]))
    np.testing.assert_allclose(found, se3.from_yaw(np.pi / 2, np.array([1.0, 2.0, 3.0])), atol=1e-12)
    assert matrix(transform([0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0])) is None
    assert matrix(transform([0.0, 0.0, 0.0], [0.0, 0.0, np.nan, 1.0])) is None
    assert matrix(transform([0.0, 0.0, 0.0], [0.0, 0.0, 1e200, 1.0])) is None
    assert matrix(transform([0.0, 1e30, 0.0], [0.0, 0.0, 0.0, 1.0])) is None
    assert matrix(transform([np.nan, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])) is None


@pytest.mark.parametrize(("frame_id", "name"), [("/base_link", "base_link"), ("velodyne", "velodyne"), ("a/b", "a/b")])
def test_frames_of_ros_1_may_begin_with_a_slash(frame_id, name):
    assert frame_name(frame_id) == name


@pytest.mark.parametrize(
    ("frames", "kept"),
    [
        (["a", "b", "a", "b"], ["a", "a"]),
        (["b", "a", "a", "a"], ["a", "a", "a"]),  # a stray first one is not that of all
        (["", "/a", "", "a"], ["", "/a", "", "a"]),
        (["", "", "", ""], ["", "", "", ""]),
    ],
)
def test_the_frame_of_most_is_that_of_all(frames, kept, caplog):
    one = OneFrame(SimpleNamespace(topics={}), "/points", frames)
    scan = Scan(0, np.ones((1, 3)))
    assert [frame for frame in frames if one.turned(scan, frame) is scan] == kept
    one.report()
    assert ("were left out" in caplog.text) == (len(kept) < len(frames))
