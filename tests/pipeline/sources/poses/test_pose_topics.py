"""Poses from topics of every type that is read, and where a LiDAR is mounted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, Encoding, serialize, typestore
from wiclosure.pipeline.sources.messages.wireless_messages import encode_header
from wiclosure.pipeline.sources.open import open_source
from wiclosure.pipeline.sources.poses.frames import StaticTransforms
from wiclosure.pipeline.sources.poses.mounting import lidar_mount
from wiclosure.pipeline.sources.poses.pose_topics import POSE_TYPES, only_pose_topic, read_pose_topic
from wiclosure.types import FloatArray, Scan

STAMPS_NS = 10**18 + np.arange(5) * 10**8
POSES = se3.from_yaw(np.arange(5) * 0.2, np.stack([np.arange(5.0), -np.arange(5.0), np.ones(5)], axis=1))
TF_TYPE = {"ros1": "tf2_msgs/msg/TFMessage", "cdr": "tf2_msgs/msg/TFMessage"}


class Messages:
    """Makes messages of one ROS version."""

    def __init__(self, encoding: Encoding) -> None:
        self.encoding, self.store = encoding, typestore(encoding)
        self.types: Any = self.store.types

    def header(self, stamp_ns: int, frame: str) -> Any:
        return encode_header(stamp_ns, self.store, frame)

    def pose(self, T: FloatArray) -> Any:
        point = self.types["geometry_msgs/msg/Point"](*T[:3, 3].tolist())
        quaternion = self.types["geometry_msgs/msg/Quaternion"](*Rotation.from_matrix(T[:3, :3]).as_quat().tolist())
        return self.types["geometry_msgs/msg/Pose"](point, quaternion)

    def transform(self, stamp_ns: int, parent: str, child: str, T: FloatArray) -> Any:
        pose = self.pose(T)
        vector = self.types["geometry_msgs/msg/Vector3"](pose.position.x, pose.position.y, pose.position.z)
        made = self.types["geometry_msgs/msg/Transform"](vector, pose.orientation)
        return self.types["geometry_msgs/msg/TransformStamped"](self.header(stamp_ns, parent), child, made)

    def message(self, msgtype: str, stamp_ns: int, T: FloatArray) -> Any:
        header = self.header(stamp_ns, "odom")
        covered = self.types["geometry_msgs/msg/PoseWithCovariance"](self.pose(T), np.zeros(36))
        stamped = self.types["geometry_msgs/msg/PoseStamped"](header, self.pose(T))
        zero = self.types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        twist = self.types["geometry_msgs/msg/Twist"](zero, zero)
        return {
            "nav_msgs/msg/Odometry": lambda: self.types["nav_msgs/msg/Odometry"](
                header, "/base_link", covered,
                self.types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
            ),
            "geometry_msgs/msg/PoseStamped": lambda: stamped,
            "geometry_msgs/msg/PoseWithCovarianceStamped": lambda: self.types[
                "geometry_msgs/msg/PoseWithCovarianceStamped"
            ](header, covered),
            "geometry_msgs/msg/TransformStamped": lambda: self.transform(stamp_ns, "odom", "base_link", T),
            "nav_msgs/msg/Path": lambda: self.types["nav_msgs/msg/Path"](
                header,
                [
                    self.types["geometry_msgs/msg/PoseStamped"](self.header(int(stamp), "odom"), self.pose(pose))
                    for stamp, pose in zip(STAMPS_NS, POSES, strict=True)
                    if stamp <= stamp_ns
                ],
            ),
            "tf2_msgs/msg/TFMessage": lambda: self.types["tf2_msgs/msg/TFMessage"](
                [self.transform(stamp_ns, "odom", "base_link", T)]
            ),
        }[msgtype]()  # fmt: skip

    def write(self, path: Path, topics: dict[str, tuple[str, list[tuple[int, Any]]]]) -> Path:
        """A bag with messages by topic: type, and reception time and message each."""
        writer: Any = Writer1(path) if self.encoding == "ros1" else Writer2(
            path, version=8, storage_plugin=StoragePlugin.MCAP
        )  # fmt: skip
        with writer:
            for name, (msgtype, messages) in topics.items():
                connection = writer.add_connection(name, msgtype, typestore=self.store)
                for stamp_ns, message in messages:
                    writer.write(connection, stamp_ns, serialize(self.store, self.encoding, message, msgtype))
        return path


TYPES = [msgtype for msgtype in POSE_TYPES if msgtype != "tf/msg/tfMessage"]


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
@pytest.mark.parametrize("msgtype", TYPES)
def test_poses_of_every_type(tmp_path: Path, encoding: Encoding, msgtype: str) -> None:
    make = Messages(encoding)
    messages = [(int(s), make.message(msgtype, int(s), T)) for s, T in zip(STAMPS_NS, POSES, strict=True)]
    path = make.write(tmp_path / ("a.bag" if encoding == "ros1" else "a"), {"/pose": (msgtype, messages)})
    read = read_pose_topic(path, "/pose", "alpha")
    np.testing.assert_array_equal(read.trajectory.stamps_ns, STAMPS_NS)
    np.testing.assert_allclose(read.trajectory.poses, POSES, atol=1e-12)
    has_body = any(word in msgtype for word in ("Odometry", "Transform", "TF"))
    assert read.body_frame == ("base_link" if has_body else "")
    assert only_pose_topic(path) == "/pose"


def test_one_of_several_transforms_is_named(tmp_path: Path) -> None:
    make = Messages("cdr")
    messages = [
        (int(s), make.types["tf2_msgs/msg/TFMessage"]([
            make.transform(int(s), "odom", "base_link", T), make.transform(int(s), "map", "odom", np.eye(4)),
        ]))
        for s, T in zip(STAMPS_NS, POSES, strict=True)
    ]  # fmt: skip
    path = make.write(tmp_path / "a", {"/tf": ("tf2_msgs/msg/TFMessage", messages)})
    np.testing.assert_allclose(read_pose_topic(path, "/tf odom->base_link", "a").trajectory.poses, POSES, atol=1e-12)
    with pytest.raises(InputError, match=r"several transforms: odom->base_link, map->odom; name one after the topic"):
        read_pose_topic(path, "/tf", "a")
    with pytest.raises(InputError, match=r"no transform odom->lidar; it has odom->base_link, map->odom"):
        read_pose_topic(path, "/tf odom->lidar", "a")


def test_messages_that_hold_no_pose_are_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    make = Messages("cdr")
    msgtype = "geometry_msgs/msg/PoseStamped"
    broken = POSES.copy()
    broken[2, 0, 3] = np.nan
    messages = [(int(s), make.message(msgtype, int(s), T)) for s, T in zip(STAMPS_NS, broken, strict=True)]
    path = make.write(tmp_path / "a", {"/pose": (msgtype, messages)})
    assert len(read_pose_topic(path, "/pose", "a").trajectory) == 4
    assert "1 of 5 messages hold no pose" in caplog.text
    with pytest.raises(InputError, match="none of 1 messages holds a pose"):
        read_pose_topic(make.write(tmp_path / "b", {"/pose": (msgtype, messages[2:3])}), "/pose", "a")


def test_one_stray_stamp_loses_one_pose(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    make = Messages("cdr")
    msgtype = "nav_msgs/msg/Odometry"
    messages = [
        (int(s), make.message(msgtype, int(s) + (3600 * 10**9 if k == 2 else 0), T))
        for k, (s, T) in enumerate(zip(STAMPS_NS, POSES, strict=True))
    ]
    read = read_pose_topic(make.write(tmp_path / "a", {"/odom": (msgtype, messages)}), "/odom", "a")
    np.testing.assert_array_equal(read.trajectory.stamps_ns, np.delete(STAMPS_NS, 2))
    assert "1 messages have stamps far from their neighbours'" in caplog.text


# -------------------------------------------------------------------------------------------------- static transforms
T_BASE_MAST = se3.from_yaw(np.pi / 2, np.array([0.0, 0, 1.0]))
T_MAST_LIDAR = se3.from_yaw(0.0, np.array([0.5, 0, 0]))
T_BASE_REAR = se3.from_yaw(np.pi, np.array([-1.0, 0, 0.3]))


def bag_of_two(path: Path, *, connected: bool = True) -> Path:
    make = Messages("cdr")
    transforms = [
        make.transform(5, "base_link", "mast", T_BASE_MAST),
        make.transform(5, "/mast", "front", T_MAST_LIDAR),
    ]
    if connected:
        transforms.append(make.transform(5, "base_link", "rear", T_BASE_REAR))
    points = np.array([[5.0, 0, 0], [0, 7.0, 1.0]])
    clouds = []
    for number in range(6):
        stamp_ns = 10**18 + number * 5 * 10**7
        scan = Scan(stamp_ns, points + number)
        clouds.append((stamp_ns, encode_scan(scan, make.store, "front" if number % 2 == 0 else "rear")))
    return make.write(
        path,
        {
            "/tf_static": ("tf2_msgs/msg/TFMessage", [(5, make.types["tf2_msgs/msg/TFMessage"](transforms))]),
            "/points": (POINT_CLOUD_TYPE, clouds),
        },
    )


def test_two_frames_on_one_topic_are_brought_into_one(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    scans = list(open_source(bag_of_two(tmp_path / "a")))
    T_front_rear = se3.inverse(T_BASE_MAST @ T_MAST_LIDAR) @ T_BASE_REAR
    points = np.array([[5.0, 0, 0], [0, 7.0, 1.0]])
    np.testing.assert_allclose(scans[2].points, points + 2, atol=1e-6)
    np.testing.assert_allclose(scans[3].points, se3.transform(T_front_rear, points + 3), atol=1e-5)
    assert "clouds of frame rear are turned into the axes of front by /tf_static" in caplog.text


def test_a_frame_that_nothing_connects_is_left_out_and_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    assert len(list(open_source(bag_of_two(tmp_path / "a", connected=False)))) == 3
    assert "3 clouds of frame rear were left out: no static transform connects it with front" in caplog.text


def test_where_the_lidar_is_mounted(tmp_path: Path) -> None:
    path = bag_of_two(tmp_path / "a")
    mount = lidar_mount(path, None, "base_link")
    assert mount.frame == "front"
    assert mount.T_body_lidar is not None
    np.testing.assert_allclose(mount.T_body_lidar, T_BASE_MAST @ T_MAST_LIDAR, atol=1e-12)
    assert lidar_mount(path, None, "imu").T_body_lidar is None


def test_transforms_along_a_tree() -> None:
    tree = StaticTransforms({("a", "b"): T_BASE_MAST, ("a", "c"): T_BASE_REAR, ("c", "d"): T_MAST_LIDAR})
    found = tree.between("b", "d")
    assert found is not None
    np.testing.assert_allclose(found, se3.inverse(T_BASE_MAST) @ T_BASE_REAR @ T_MAST_LIDAR, atol=1e-12)
    assert tree.between("a", "x") is None
    assert tree.between("a", "/a") is not None
