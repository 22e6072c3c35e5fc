"""A recorded drive whose own poses stand in for KISS-ICP's, from a TUM file and from a topic of a bag."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from scipy.spatial.transform import Rotation

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.trajectories.tum import write_tum
from wiclosure.pipeline.config import Config
from wiclosure.pipeline.data.dataset import load_dataset
from wiclosure.pipeline.data.dataset_file import write_dataset
from wiclosure.pipeline.data.inputs import RobotInput
from wiclosure.pipeline.data.odometry_reader import near_origin
from wiclosure.pipeline.data.open_inputs import open_inputs
from wiclosure.pipeline.runtime.cache import StageCache
from wiclosure.pipeline.runtime.progress import NoProgress
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, Encoding, serialize, typestore
from wiclosure.pipeline.sources.messages.wireless_messages import encode_header
from wiclosure.pipeline.sources.poses.pose_topics import ODOMETRY_TYPE, read_pose_topic
from wiclosure.pipeline.stages.odometry import front_ends, remarks
from wiclosure.types import FloatArray, Scan, Trajectory

SHIFT = se3.from_yaw(0.4, np.array([3.0, -1.0, 0.5]))


class Drive(Protocol):
    poses: FloatArray
    stamps_ns: np.ndarray

    def __getitem__(self, index: int) -> Scan: ...


def messages(
    scans: list[Scan], way: Trajectory, encoding: Encoding, body_frame: str = "base_link"
) -> Iterator[tuple[str, int, memoryview]]:
    store = typestore(encoding)
    types = store.types
    for scan in scans:
        yield "/points", scan.stamp_ns, serialize(store, encoding, encode_scan(scan, store), POINT_CLOUD_TYPE)
    for stamp_ns, pose in zip(way.stamps_ns, way.poses, strict=True):
        x, y, z = pose[:3, 3]
        qx, qy, qz, qw = Rotation.from_matrix(pose[:3, :3]).as_quat()
        zero = types["geometry_msgs/msg/Vector3"](0.0, 0.0, 0.0)
        message = types[ODOMETRY_TYPE](
            header=encode_header(int(stamp_ns), store, "odom"),
            child_frame_id=body_frame,
            pose=types["geometry_msgs/msg/PoseWithCovariance"](
                types["geometry_msgs/msg/Pose"](
                    types["geometry_msgs/msg/Point"](x, y, z), types["geometry_msgs/msg/Quaternion"](qx, qy, qz, qw)
                ),
                np.zeros(36),
            ),
            twist=types["geometry_msgs/msg/TwistWithCovariance"](
                types["geometry_msgs/msg/Twist"](zero, zero), np.zeros(36)
            ),
        )
        yield "/odom", int(stamp_ns), serialize(store, encoding, message, ODOMETRY_TYPE)


def write_bag(
    path: Path, scans: list[Scan], way: Trajectory, encoding: Encoding, body_frame: str = "base_link"
) -> None:
    writer = Writer1(path) if encoding == "ros1" else Writer2(path, version=8, storage_plugin=StoragePlugin.MCAP)
    with writer:
        store = typestore(encoding)
        topics = {
            topic: writer.add_connection(topic, msgtype, typestore=store)
            for topic, msgtype in (("/points", POINT_CLOUD_TYPE), ("/odom", ODOMETRY_TYPE))
        }
        for topic, stamp_ns, raw in messages(scans, way, encoding, body_frame):
            writer.write(topics[topic], stamp_ns, raw)  # type: ignore[arg-type]  # each connection is of its own writer


def static_transform(parent: str, child: str) -> Any:
    types = typestore("ros1").types
    return types["tf2_msgs/msg/TFMessage"](
        [
            types["geometry_msgs/msg/TransformStamped"](
                encode_header(0, typestore("ros1"), parent),
                child,
                types["geometry_msgs/msg/Transform"](
                    types["geometry_msgs/msg/Vector3"](0.0, 0.0, 1.5),
                    types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                ),
            )
        ]
    )


def write_static_bag(path: Path, scans: list[Scan], way: Trajectory, body_frame: str) -> None:
    store, names = typestore("ros1"), {"/points": POINT_CLOUD_TYPE, "/odom": ODOMETRY_TYPE}
    with Writer1(path) as writer:
        topics = {topic: writer.add_connection(topic, msgtype, typestore=store) for topic, msgtype in names.items()}
        static = writer.add_connection("/tf_static", "tf2_msgs/msg/TFMessage", typestore=store)
        raw = serialize(store, "ros1", static_transform("base_link", "lidar"), "tf2_msgs/msg/TFMessage")
        writer.write(static, int(way.stamps_ns[0]), raw)
        for topic, stamp_ns, raw in messages(scans, way, "ros1", body_frame):
            writer.write(topics[topic], stamp_ns, raw)


def small_room(count: int = 6) -> tuple[list[Scan], Trajectory]:
    points = np.random.default_rng(0).uniform(-1, 1, (800, 3)) * [10, 8, 3]
    stamps_ns = 10**12 + np.arange(count) * 10**8
    way = Trajectory("alpha", stamps_ns, se3.from_yaw(np.arange(count) * 0.1, np.arange(count)[:, None] * [1.0, 0, 0]))
    return [Scan(int(stamp), points) for stamp in stamps_ns], way


def followed(robots: tuple[RobotInput, ...], **odometry: str) -> Trajectory:
    config = Config.model_validate({"odometry": odometry})
    fronts, _ = front_ends(robots, config, cache=StageCache(None), jobs=1, progress=NoProgress())
    return fronts["alpha"].odometry


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
def test_a_recorded_drive_goes_where_its_own_odometry_says(
    kitti_drive: Drive, tmp_path: Path, encoding: Encoding
) -> None:
    indices = range(0, 36, 3)
    scans = [kitti_drive[k] for k in indices]
    truth = Trajectory("alpha", kitti_drive.stamps_ns[list(indices)], kitti_drive.poses[list(indices)])
    bag = tmp_path / ("alpha.bag" if encoding == "ros1" else "alpha")
    write_bag(bag, scans, truth, encoding)
    write_tum(tmp_path / "odom.tum", truth)
    (tmp_path / "topic.yaml").write_text(
        f"robots: {{alpha: {{scans: {bag.name}, topic: /points, odometry_topic: /odom}}}}"
    )
    (tmp_path / "file.yaml").write_text(f"robots: {{alpha: {{scans: {bag.name}, topic: /points, odometry: odom.tum}}}}")
    for name in ("topic.yaml", "file.yaml"):
        robots = open_inputs([str(tmp_path / name)]).robots
        way = followed(robots)
        np.testing.assert_array_equal(way.stamps_ns, truth.stamps_ns)
        np.testing.assert_allclose(way.poses, truth.poses, atol=1e-9)
    # Asked to, KISS-ICP does it all the same: about the way, not exactly.
    gap = se3.between(way.poses[-1], se3.between(truth.poses[0], followed(robots, source="kiss-icp").poses[-1]))
    assert np.linalg.norm(gap[:3, 3]) > 1e-6


def test_clouds_are_deskewed_along_the_recorded_way(tmp_path: Path) -> None:
    from wiclosure.frontends.config import OdometrySettings
    from wiclosure.frontends.odometry.recorded_odometry import RecordedOdometry

    rng = np.random.default_rng(0)
    world = rng.uniform(-20, 20, (5000, 3))
    stamps_ns = 10**12 + np.arange(40) * 10**7
    way = Trajectory("alpha", stamps_ns, se3.from_yaw(0.02 * np.arange(40), np.arange(40)[:, None] * [0.1, 0.02, 0]))
    times = rng.uniform(0.0, 0.1, len(world))
    seen_from = way.at(stamps_ns[10] + np.rint(times * 1e9).astype(np.int64))
    points = np.einsum("nij,nj->ni", se3.inverse(seen_from)[:, :3, :3], world - seen_from[:, :3, 3])
    stamp_ns, pose, deskewed = RecordedOdometry(OdometrySettings(), way).register(
        Scan(int(stamps_ns[10]), points, times)
    )
    assert stamp_ns == stamps_ns[10] + round(times.max() * 1e9)
    np.testing.assert_allclose(se3.transform(pose, deskewed), world, atol=0.02)
    assert np.abs(points - deskewed).max() > 0.5


def test_a_lidar_beside_the_wheels_is_put_in_its_place(tmp_path: Path) -> None:
    scans, way = small_room()
    write_bag(tmp_path / "alpha.bag", scans, Trajectory("alpha", way.stamps_ns, way.poses @ se3.inverse(SHIFT)), "ros1")
    pose = [*SHIFT[:3, 3], *Rotation.from_matrix(SHIFT[:3, :3]).as_quat()]
    (tmp_path / "dataset.yaml").write_text(
        f"robots: {{alpha: {{scans: alpha.bag, odometry_topic: /odom, lidar_pose: {[float(n) for n in pose]}}}}}"
    )
    np.testing.assert_allclose(followed(open_inputs([str(tmp_path)]).robots).poses, way.poses, atol=1e-9)
    # What was read is written again the same.
    (tmp_path / "again").mkdir()
    dataset = load_dataset([str(tmp_path)])
    write_dataset(tmp_path / "again.yaml", dataset.robots, dataset.wireless)
    assert load_dataset([str(tmp_path / "again.yaml")]).robots == dataset.robots


def test_scans_outside_the_odometry_are_left_out_and_counted(tmp_path: Path) -> None:
    scans, way = small_room()
    write_bag(tmp_path / "alpha.bag", scans, way.subset(np.arange(1, 5)), "ros1")
    (tmp_path / "dataset.yaml").write_text("robots: {alpha: {scans: alpha.bag, odometry_topic: /odom}}")
    (robot,) = open_inputs([str(tmp_path)]).robots
    fronts, _ = front_ends([robot], Config(), cache=StageCache(None), jobs=1, progress=NoProgress())
    assert len(fronts["alpha"].odometry) == 4
    assert remarks(robot, fronts["alpha"], Config()) == (
        "alpha: 2 of 6 scans lie outside the recorded odometry and were skipped",
    )


def test_messages_that_repeat_are_left_out(tmp_path: Path) -> None:
    scans, way = small_room()
    write_bag(tmp_path / "one.bag", scans, way, "ros1")
    order = np.array([0, 1, 1, 2, 3, 3, 4])

    class Repeated:
        stamps_ns, poses = way.stamps_ns[order], way.poses[order]

    write_bag(tmp_path / "two.bag", scans, Repeated(), "ros1")  # type: ignore[arg-type]  # no Trajectory may repeat a stamp
    found = read_pose_topic(tmp_path / "two.bag", "/odom", "alpha").trajectory
    np.testing.assert_array_equal(found.stamps_ns, way.stamps_ns[:5])


@pytest.mark.parametrize(
    ("entry", "complaint"),
    [
        ("odometry_topic: /wheels", r"robot alpha: .*has no topic /wheels; its topics of poses: /odom"),
        (
            "odometry_topic: /points",
            r"robot alpha: topic /points of .* is sensor_msgs/msg/PointCloud2; expected one of nav_msgs",
        ),
        ("odometry: none.tum", r'"odometry" of robot alpha names .*none.tum, which does not exist'),
        ("odometry: dataset.yaml, odometry_topic: /odom", r'has "odometry" and "odometry_topic".* no bag; name one'),
        (
            "odometry_topic: /odom, lidar_pose: [1, 2]",
            r'"lidar_pose" of robot alpha is \[1, 2\]; expected seven numbers',
        ),
    ],
)
def test_what_is_wrong_is_said_in_one_line(tmp_path: Path, entry: str, complaint: str) -> None:
    write_bag(tmp_path / "alpha.bag", *small_room(2), "ros1")
    (tmp_path / "dataset.yaml").write_text(f"robots: {{alpha: {{scans: alpha.bag, {entry}}}}}")
    with pytest.raises(InputError, match=complaint):
        open_inputs([str(tmp_path)])


# ------------------------------------------------------------------------------------------ in another bag, or anywhere
def test_odometry_and_truth_of_another_bag(tmp_path: Path) -> None:
    scans, way = small_room()
    moved = way.moved(SHIFT)
    write_bag(tmp_path / "lidar.bag", scans, way, "ros1")
    write_bag(tmp_path / "other", scans, moved, "cdr")
    (tmp_path / "dataset.yaml").write_text(
        "robots: {alpha: {scans: lidar.bag, topic: /points, odometry: other, odometry_topic: /odom,"
        " ground_truth: other, ground_truth_topic: /odom}}"
    )
    (robot,) = open_inputs([str(tmp_path)]).robots
    assert robot.odometry is not None
    assert robot.ground_truth is not None
    np.testing.assert_allclose(robot.odometry.poses, moved.poses, atol=1e-12)
    np.testing.assert_allclose(robot.ground_truth.poses, moved.poses, atol=1e-12)
    (tmp_path / "dataset.yaml").write_text("robots: {alpha: {scans: lidar.bag, topic: /points, odometry: other}}")
    (robot,) = open_inputs([str(tmp_path)]).robots  # its only topic of poses
    assert robot.odometry is not None
    np.testing.assert_allclose(robot.odometry.poses, moved.poses, atol=1e-12)


def test_frames_that_nothing_connects_are_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_bag(tmp_path / "a.bag", *small_room(), "ros1")
    (tmp_path / "dataset.yaml").write_text("robots: {alpha: {scans: a.bag, topic: /points, odometry_topic: /odom}}")
    open_inputs([str(tmp_path)])
    assert (
        "tells the path of base_link, its clouds are in lidar, and no static transform connects the two" in caplog.text
    )


def test_clouds_in_the_frame_that_the_odometry_follows_need_no_transform(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_bag(tmp_path / "a.bag", *small_room(), "ros1", body_frame="lidar")
    (tmp_path / "dataset.yaml").write_text("robots: {alpha: {scans: a.bag, topic: /points, odometry_topic: /odom}}")
    open_inputs([str(tmp_path)])
    assert "tf_static" not in caplog.text
    assert "static transform" not in caplog.text


@pytest.mark.parametrize(("body_frame", "height_m", "said"), [("base_link", 1.5, False), ("", 0.0, True)])
def test_static_transforms_need_the_odometrys_child_frame(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, body_frame: str, height_m: float, said: bool
) -> None:
    write_static_bag(tmp_path / "a.bag", *small_room(), body_frame)
    (tmp_path / "dataset.yaml").write_text("robots: {alpha: {scans: a.bag, topic: /points, odometry_topic: /odom}}")
    (robot,) = open_inputs([str(tmp_path)]).robots
    assert robot.odometry is not None
    assert robot.odometry.positions[0, 2] == pytest.approx(height_m)
    assert ("name no child frame, so the 1 static transforms" in caplog.text) == said


@pytest.mark.parametrize("far_m", [(458_058.6, 5_429_380.2, 162.9), (-12_000.0, 3.0, 0.0)])
def test_odometry_far_from_its_origin_is_used_near_one(far_m: tuple[float, float, float]) -> None:
    _, way = small_room()
    T_far_odom = se3.from_yaw(0.3, np.array(far_m))
    near, origin_m = near_origin(way.moved(T_far_odom))
    assert np.abs(near.positions[0]).max() <= 500
    assert all(number % 1000 == 0 for number in origin_m)
    np.testing.assert_allclose(near.positions + origin_m, way.moved(T_far_odom).positions, atol=1e-8)


def test_odometry_near_its_origin_stays_as_it_is() -> None:
    _, way = small_room()
    assert near_origin(way) == (way, (0.0, 0.0, 0.0))
