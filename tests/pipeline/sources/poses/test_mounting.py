"""Where a LiDAR is mounted: base_link -> mast -> lidar, in the bag of the clouds or in one beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, typestore
from wiclosure.pipeline.sources.messages.wireless_messages import encode_header
from wiclosure.pipeline.sources.poses.mounting import lidar_mount
from wiclosure.types import FloatArray, Scan

STORE: Any = typestore("ros1")
TF_TYPE = "tf2_msgs/msg/TFMessage"
T_BASE_MAST = se3.from_yaw(np.pi / 2, np.array([0.2, 0.0, 1.0]))
T_MAST_LIDAR = se3.from_yaw(0.0, np.array([0.5, 0.0, 0.1]))
T_BASE_LIDAR = np.array([[0, -1, 0, 0.2], [1, 0, 0, 0.5], [0, 0, 1, 1.1], [0, 0, 0, 1.0]])


def transform(parent: str, child: str, T: FloatArray) -> Any:
    types, yaw = STORE.types, float(se3.yaw(T))
    vector = types["geometry_msgs/msg/Vector3"](*T[:3, 3].tolist())
    quaternion = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
    made = types["geometry_msgs/msg/Transform"](vector, quaternion)
    return types["geometry_msgs/msg/TransformStamped"](encode_header(5, STORE, parent), child, made)


def bag(path: Path, transforms: list[Any], *, clouds: int = 1) -> Path:
    with Writer(path) as writer:
        if transforms:
            static = writer.add_connection("/tf_static", TF_TYPE, typestore=STORE)
            writer.write(static, 5, STORE.serialize_ros1(STORE.types[TF_TYPE](transforms), TF_TYPE))
        points = writer.add_connection("/points", POINT_CLOUD_TYPE, typestore=STORE)
        for n in range(clouds):
            message = encode_scan(Scan(10**18 + n, np.ones((5, 3))), STORE, "/lidar")
            writer.write(points, 10**18 + n, STORE.serialize_ros1(message, POINT_CLOUD_TYPE))
    return path


@pytest.fixture
def tree() -> list[Any]:
    return [transform("base_link", "mast", T_BASE_MAST), transform("mast", "lidar", T_MAST_LIDAR)]


def test_transforms_are_composed_along_the_tree(tmp_path: Path, tree: list[Any]) -> None:
    frame, found = lidar_mount(bag(tmp_path / "a.bag", tree), None, "base_link")
    assert frame == "lidar"
    assert found is not None
    np.testing.assert_allclose(found, T_BASE_LIDAR, atol=1e-12)


def test_the_body_may_be_any_frame_of_the_tree(tmp_path: Path, tree: list[Any]) -> None:
    path = bag(tmp_path / "a.bag", tree)
    for body, expected in (("mast", T_MAST_LIDAR), ("lidar", np.eye(4))):
        found = lidar_mount(path, "/points", body).T_body_lidar
        assert found is not None
        np.testing.assert_allclose(found, expected, atol=1e-12)
    assert lidar_mount(path, None, "imu") == ("lidar", None)


def test_another_bag_tells_where_that_of_the_clouds_does_not(tmp_path: Path, tree: list[Any]) -> None:
    clouds, beside = bag(tmp_path / "a.bag", []), bag(tmp_path / "b.bag", tree)
    assert lidar_mount(clouds, None, "base_link") == ("lidar", None)
    found = lidar_mount(clouds, None, "base_link", beside).T_body_lidar
    assert found is not None
    np.testing.assert_allclose(found, T_BASE_LIDAR, atol=1e-12)


def test_the_own_transforms_go_before_those_beside(tmp_path: Path, tree: list[Any]) -> None:
    own = bag(tmp_path / "a.bag", tree)
    other = bag(tmp_path / "b.bag", [transform("base_link", "lidar", np.eye(4))])
    found = lidar_mount(own, None, "base_link", other).T_body_lidar
    assert found is not None
    np.testing.assert_allclose(found, T_BASE_LIDAR, atol=1e-12)


def test_what_lies_beside_need_not_be_a_bag(tmp_path: Path) -> None:
    poses = tmp_path / "poses.tum"
    poses.write_text("1 0 0 0 0 0 0 1\n")
    assert lidar_mount(bag(tmp_path / "a.bag", []), None, "base_link", poses) == ("lidar", None)


def test_a_topic_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="/other"):
        lidar_mount(bag(tmp_path / "a.bag", []), "/other", "base_link")
