"""Bags that are whole but odd: metadata that is stale, types without definition, other encodings, other orders."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from wiclosure.errors import InputError
from wiclosure.pipeline.data.dataset_writer import write_ros2_bag
from wiclosure.pipeline.sources.info import recording_info
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, typestore
from wiclosure.pipeline.sources.messages.wireless_messages import encode_header
from wiclosure.pipeline.sources.open import open_source
from wiclosure.types import Scan

from .conftest import START_NS
from .mcap_bytes import Topic, mcap_bytes

ROS2 = typestore("cdr")


def raw(scan: Scan) -> bytes:
    return bytes(ROS2.serialize_cdr(encode_scan(scan, ROS2), POINT_CLOUD_TYPE))


def clouds(scans: list[Scan], name: str = "/points") -> Topic:
    return Topic(name, "sensor_msgs/msg/PointCloud2", [(scan.stamp_ns, raw(scan)) for scan in scans])


def assert_read(path: Path, scans: list[Scan], topic: str | None = None) -> None:
    source = open_source(path, topic=topic)
    assert len(source) == len(scans)
    read = list(source)
    assert [scan.stamp_ns for scan in read] == [scan.stamp_ns for scan in scans]
    for scan, original in zip(read, scans, strict=True):
        np.testing.assert_array_equal(scan.points, original.points)
    counts = {found.name: found.count for found in recording_info(path).topics}
    assert counts[topic or "/points"] == len(scans)


# ------------------------------------------------------------------------------------------------------------ metadata
def changed(folder: Path, bag: Path, change: Any) -> Path:
    """A copy of the bag whose metadata is changed."""
    copy = folder / "copy"
    shutil.copytree(bag, copy)
    content = yaml.safe_load((copy / "metadata.yaml").read_text())
    change(content["rosbag2_bagfile_information"])
    (copy / "metadata.yaml").write_text(yaml.safe_dump(content))
    return copy


def no_topics(about: dict[str, Any]) -> None:
    about["topics_with_message_count"] = []
    about["message_count"] = 0


def other_qos(about: dict[str, Any]) -> None:
    for topic in about["topics_with_message_count"]:
        topic["topic_metadata"]["offered_qos_profiles"] = "- history: 3\n  depth: 7\n  reliability: 1\n"


def other_count(about: dict[str, Any]) -> None:
    about["topics_with_message_count"][0]["message_count"] = 99
    about["message_count"] = 99


@pytest.mark.parametrize("kind", ["mcap", "sqlite3"])
@pytest.mark.parametrize(
    "change",
    [
        other_qos,
        no_topics,
        other_count,
        lambda about: about.update(version=10),
        lambda about: about.update(storage_identifier=""),
        lambda about: about.update(relative_file_paths=["somewhere/else_0.mcap"]),
        lambda about: about.update(relative_file_paths=None),
        lambda about: about.update(duration="long"),
    ],
)
def test_metadata_that_differs_from_the_storage(
    tmp_path: Path, bags: dict[str, Path], scans: list[Scan], kind: str, change: Any
) -> None:
    assert_read(changed(tmp_path, bags[kind], change), scans)


@pytest.mark.parametrize("text", ["", "- a", "{", "rosbag2_bagfile_information: 3\n", "\x00"])
def test_metadata_that_is_none(tmp_path: Path, bags: dict[str, Path], scans: list[Scan], text: str) -> None:
    shutil.copytree(bags["mcap"], tmp_path / "copy")
    (tmp_path / "copy" / "metadata.yaml").write_text(text)
    assert_read(tmp_path / "copy", scans)


def test_a_file_that_metadata_names_is_missing(
    tmp_path: Path, scans: list[Scan], caplog: pytest.LogCaptureFixture
) -> None:
    write_ros2_bag(tmp_path / "run_0", scans[:3])
    write_ros2_bag(tmp_path / "run_1", scans[3:])
    folder = tmp_path / "split"
    folder.mkdir()
    for name in ("run_0", "run_1"):
        shutil.copy(tmp_path / name / f"{name}.mcap", folder)
    about = {"relative_file_paths": ["run_0.mcap", "run_1.mcap", "run_2.mcap"]}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": about}))
    assert_read(folder, scans)
    assert "run_2.mcap" in caplog.text
    about["relative_file_paths"] = ["run_0.mcap"]  # a recorder that was killed
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": about}))
    assert_read(folder, scans)


# -------------------------------------------------------------------------------------------------- other topics, order
@pytest.mark.parametrize("chunked", [False, True])
@pytest.mark.parametrize(
    "other",
    [
        Topic("/status", "my_pkg/msg/Status", [(5, b"\0\1\0\0")], schema_encoding="unknown"),
        Topic("/status", "my_pkg/msg/Status", [(5, b"\0\1\0\0")], schema_encoding="ros2idl", definition=b"struct {"),
        Topic("/health", "Health", [(5, b"{}")], "json", "jsonschema", b"{}"),
        Topic("/camera", "foxglove.Image", [(5, b"\x0a")], "protobuf", "protobuf", bytes(range(256))),
    ],
)
def test_other_topics_do_not_matter(tmp_path: Path, scans: list[Scan], other: Topic, chunked: bool) -> None:
    (tmp_path / "a.mcap").write_bytes(mcap_bytes([clouds(scans), other], chunked=chunked))
    assert_read(tmp_path / "a.mcap", scans)
    (topic,) = (topic for topic in recording_info(tmp_path / "a.mcap").topics if topic.name == other.name)
    assert topic.count == 1
    assert (other.encoding in topic.msgtype) == (other.encoding != "cdr")


def test_a_type_without_definition_in_sqlite(tmp_path: Path, bags: dict[str, Path], scans: list[Scan]) -> None:
    shutil.copytree(bags["sqlite3"], tmp_path / "copy")
    with closing(sqlite3.connect(next((tmp_path / "copy").glob("*.db3")))) as database, database:
        database.execute("INSERT INTO topics VALUES (7, '/status', 'my_pkg/msg/Status', 'cdr', '', '')")
        database.execute("INSERT INTO message_definitions VALUES (7, 'my_pkg/msg/Status', 'unknown', '', '')")
    assert_read(tmp_path / "copy", scans)


@pytest.mark.parametrize("chunked", [False, True])
@pytest.mark.parametrize("order", [[0, 2, 1, 3, 5, 4], [5, 4, 3, 2, 1, 0]])
def test_messages_out_of_order(tmp_path: Path, scans: list[Scan], chunked: bool, order: list[int]) -> None:
    (tmp_path / "a.mcap").write_bytes(mcap_bytes([clouds([scans[k] for k in order])], chunked=chunked))
    assert_read(tmp_path / "a.mcap", scans)


def test_a_file_that_was_not_closed_is_still_damaged(tmp_path: Path, scans: list[Scan]) -> None:
    (tmp_path / "a.mcap").write_bytes(mcap_bytes([clouds(scans)], footer=False))
    with pytest.raises(InputError, match=r"not closed by its recorder.*6 messages can be read.*--salvage"):
        open_source(tmp_path / "a.mcap")


def test_clouds_in_another_encoding_are_named(tmp_path: Path) -> None:
    topic = Topic("/points", "sensor_msgs/msg/PointCloud2", [(5, b"{}")], "json", "jsonschema", b"{}")
    (tmp_path / "a.mcap").write_bytes(mcap_bytes([topic]))
    with pytest.raises(InputError, match=r"/points is sensor_msgs/msg/PointCloud2, encoded as json: record it as ROS"):
        open_source(tmp_path / "a.mcap")


@pytest.mark.parametrize(
    ("msgtype", "says"),
    [
        ("velodyne_msgs/msg/VelodyneScan", "raw Velodyne packets.*velodyne_pointcloud"),
        ("ouster_ros/msg/PacketMsg", "raw Ouster packets.*ouster_ros"),
        ("rslidar_msg/msg/RslidarPacket", "raw RoboSense packets.*rslidar_sdk"),
        ("hesai_ros_driver/msg/UdpFrame", "raw Hesai packets"),
        ("sensor_msgs/msg/PointCloud", "point_cloud_converter"),
        ("sensor_msgs/msg/LaserScan", "planar laser"),
        ("foxglove.PointCloud", "Foxglove"),
    ],
)
def test_what_cannot_be_read_is_named_with_the_way_out(tmp_path: Path, msgtype: str, says: str) -> None:
    (tmp_path / "a.mcap").write_bytes(mcap_bytes([Topic("/scan", msgtype, [(5, b"\0\1\0\0")])]))
    with pytest.raises(InputError, match=f"/scan is {msgtype} .*{says}"):
        open_source(tmp_path / "a.mcap")


# ------------------------------------------------------------------------------------------------------------- messages
def test_a_default_message_is_an_empty_scan(tmp_path: Path, scans: list[Scan]) -> None:
    message = encode_scan(Scan(0, np.zeros((0, 3))), ROS2)
    message.fields, message.point_step = [], 0
    empty = bytes(ROS2.serialize_cdr(message, POINT_CLOUD_TYPE))
    topic = clouds(scans)._replace(messages=[(scans[0].stamp_ns - 10**8, empty), *clouds(scans).messages])
    (tmp_path / "a.mcap").write_bytes(mcap_bytes([topic]))
    read = list(open_source(tmp_path / "a.mcap"))
    assert [len(scan.points) for scan in read] == [0] + [300] * 6
    assert recording_info(tmp_path / "a.mcap").topics[0].count == 7


@pytest.mark.parametrize("kind", ["mcap", "sqlite3", "ros1"])
def test_a_stray_stamp_loses_one_scan(tmp_path: Path, scans: list[Scan], kind: str) -> None:
    from wiclosure.pipeline.data.dataset_writer import write_ros1_bag

    ahead = [Scan(s.stamp_ns + (3600 * 10**9 if k == 2 else 0), s.points) for k, s in enumerate(scans)]
    if kind == "ros1":
        write_ros1_bag(tmp_path / "a", ahead)  # by its time of reception it comes last
    else:
        write_ros2_bag(tmp_path / "a", ahead, storage="mcap" if kind == "mcap" else "sqlite3")
    read = [scan.stamp_ns for scan in open_source(tmp_path / "a")]
    assert read[:5] == [scan.stamp_ns for k, scan in enumerate(scans) if k != 2]


def test_topics_of_one_name_and_two_types(tmp_path: Path, scans: list[Scan]) -> None:
    other = Topic("/points", "std_msgs/msg/Empty", [(5, b"\0\1\0\0\0")])
    (tmp_path / "a.mcap").write_bytes(mcap_bytes([other, clouds(scans)]))
    assert_read(tmp_path / "a.mcap", scans)


# ------------------------------------------------------------------------------------------- several sensors, one topic
def transform_topic(parent: str, child: str, x: float) -> Topic:
    types = ROS2.types
    vector, turn = types["geometry_msgs/msg/Vector3"](x=x, y=0.0, z=0.0), types["geometry_msgs/msg/Quaternion"]
    stamped = types["geometry_msgs/msg/TransformStamped"](
        header=encode_header(START_NS, ROS2, parent),
        child_frame_id=child,
        transform=types["geometry_msgs/msg/Transform"](translation=vector, rotation=turn(x=0.0, y=0.0, z=0.0, w=1.0)),
    )
    message = types["tf2_msgs/msg/TFMessage"](transforms=[stamped])
    return Topic(
        "/tf_static",
        "tf2_msgs/msg/TFMessage",
        [(START_NS, bytes(ROS2.serialize_cdr(message, "tf2_msgs/msg/TFMessage")))],
    )


def framed(scan: Scan, frame_id: str, later_ns: int = 0) -> tuple[int, bytes]:
    message = encode_scan(scan, ROS2, frame_id)
    return scan.stamp_ns + later_ns, bytes(ROS2.serialize_cdr(message, POINT_CLOUD_TYPE))


@pytest.mark.parametrize("later_ns", [0, 30_000_000])
def test_two_sensors_with_equal_stamps_are_merged(
    tmp_path: Path, scans: list[Scan], caplog: pytest.LogCaptureFixture, later_ns: int
) -> None:
    messages = [framed(scan, frame, at) for scan in scans for frame, at in (("left", 0), ("right", later_ns))]
    path = tmp_path / "two.mcap"
    path.write_bytes(
        mcap_bytes([Topic("/points", "sensor_msgs/msg/PointCloud2", messages), transform_topic("left", "right", 2.0)])
    )
    read = list(open_source(path, topic="/points"))
    assert [scan.stamp_ns for scan in read] == [scan.stamp_ns for scan in scans]
    for scan, original in zip(read, scans, strict=True):
        np.testing.assert_allclose(
            scan.points, np.vstack([original.points, original.points + np.array([2.0, 0.0, 0.0])])
        )
        assert scan.times is not None
    assert "same stamp were merged" in caplog.text


def test_parts_of_one_frame_and_stamp_are_merged_and_copies_left_out(tmp_path: Path, scans: list[Scan]) -> None:
    halves = [Scan(scan.stamp_ns, scan.points[half::2]) for scan in scans for half in (0, 1)]
    messages = [framed(scan, "base", number % 2 * 1_000_000) for number, scan in enumerate(halves)]
    path = tmp_path / "halves.mcap"
    path.write_bytes(mcap_bytes([Topic("/points", "sensor_msgs/msg/PointCloud2", [*messages, messages[-1]])]))
    read = list(open_source(path))
    assert [len(scan.points) for scan in read] == [len(scan.points) for scan in scans]


def test_a_stamp_that_stands_still_once_merges_nothing(tmp_path: Path, scans: list[Scan]) -> None:
    messages = [framed(scan, "base") for scan in scans]
    stuck = Scan(scans[2].stamp_ns, scans[3].points)
    messages[3] = framed(stuck, "base", 100_000_000)
    path = tmp_path / "stuck.mcap"
    path.write_bytes(mcap_bytes([Topic("/points", "sensor_msgs/msg/PointCloud2", messages)]))
    assert [len(scan.points) for scan in open_source(path)] == [len(scans[0].points)] * len(scans)
