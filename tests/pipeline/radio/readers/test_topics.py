"""Radio from topics: families of Range topics, poses, drivers' own messages by the paths of their fields."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from wiclosure.errors import ConfigError, InputError
from wiclosure.pipeline.radio.presets import presets
from wiclosure.pipeline.radio.read import read_radio
from wiclosure.pipeline.radio.readers.message_fields import FieldPath
from wiclosure.pipeline.radio.readers.tag_names import TagNames
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.radio.unused import unused_radio
from wiclosure.pipeline.radio.words import sources_of_words
from wiclosure.types import WirelessMeasurement

START_NS = 1_700_000_000_000_000_000
RANGE = "sensor_msgs/msg/Range"

# Messages of drivers, field by field as their repositories define them (see the presets).
MESSAGES: Mapping[str, Mapping[str, str]] = {
    "nlink_parser/msg/LinktrackNodeframe2": {
        "nlink_parser/msg/LinktrackNode2": "uint8 role\nuint8 id\nfloat32 dis\nfloat32 fp_rssi\nfloat32 rx_rssi\n",
        "nlink_parser/msg/LinktrackNodeframe2": (
            "uint8 role\nuint8 id\nuint32 local_time\nuint32 system_time\nfloat32 voltage\nfloat32[3] pos_3d\n"
            "nlink_parser/LinktrackNode2[] nodes\n"
        ),
    },
    "nlink_parser/msg/LinktrackAoaNodeframe0": {
        "nlink_parser/msg/LinktrackAoaNode0": "uint8 role\nuint8 id\nfloat32 dis\nfloat32 angle\nfloat32 fp_rssi\n",
        "nlink_parser/msg/LinktrackAoaNodeframe0": "uint8 role\nuint8 id\nnlink_parser/LinktrackAoaNode0[] nodes\n",
    },
    "dwm1001c_ros/msg/UWBMeas": {
        "dwm1001c_ros/msg/Anchor": "string id\ngeometry_msgs/Point location\nfloat64 dist\n",
        "dwm1001c_ros/msg/UWBMeas": "dwm1001c_ros/Anchor[] measurements\n",
    },
    "uwb_msgs/msg/TwoWayRangeStamped": {
        "uwb_msgs/msg/TwoWayRangeStamped": (
            "std_msgs/Header header\nfloat64 range_raw\nfloat64 range_corr\nfloat32 rr\n"
            "uint32 uwb_id1\nuint32 uwb_id2\n"
        )
    },
    "uwb_msgs/msg/RangeStamped": {
        "uwb_msgs/msg/RangeStamped": (
            "std_msgs/Header header\nfloat32 range\nuint64 from_id\nuint64 to_id\nfloat32 covariance\nuint64 tx1\n"
        )
    },
    "gtec_msgs/msg/Ranging": {
        "gtec_msgs/msg/Ranging": "int16 anchor_id\nint16 tag_id\nint32 range\nint32 seq\nfloat64 rss\n"
    },
    "inf_uwb_ros/msg/remote_uwb_info": {
        "inf_uwb_ros/msg/remote_uwb_info": (
            "std_msgs/Header header\nuint32 self_id\nuint32[] node_ids\nfloat32[] node_dis\nbool[] active\n"
        )
    },
    "mrs_msgs/msg/RangeWithCovarianceArrayStamped": {
        "mrs_msgs/msg/RangeWithCovarianceIdentified": "uint64 id\nsensor_msgs/Range range\nfloat64 variance\n",
        "mrs_msgs/msg/RangeWithCovarianceArrayStamped": (
            "std_msgs/Header header\nmrs_msgs/RangeWithCovarianceIdentified[] ranges\n"
        ),
    },
}


def write_bag(path: Path, topics: Mapping[str, tuple[str, Sequence[Any]]], store: Any) -> Path:
    with Writer2(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, (msgtype, messages) in topics.items():
            connection = writer.add_connection(topic, msgtype, typestore=store)
            for number, message in enumerate(messages):
                writer.write(connection, START_NS + 7 + number * 10**8, store.serialize_cdr(message, msgtype))
    return path


def typestore(*msgtypes: str) -> Any:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for msgtype in msgtypes:
        for name, text in MESSAGES[msgtype].items():
            store.register(get_types_from_msg(text, name))
    return store


def header(store: Any, frame_id: str = "tag", stamp_ns: int = START_NS) -> Any:
    stamp = store.types["builtin_interfaces/msg/Time"](sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return store.types["std_msgs/msg/Header"](stamp=stamp, frame_id=frame_id)


def range_message(store: Any, value: float, frame_id: str = "tag", stamp_ns: int = START_NS) -> Any:
    return store.types[RANGE](
        header=header(store, frame_id, stamp_ns), radiation_type=0, field_of_view=0.1,
        min_range=0.2, max_range=100.0, range=value,
    )  # fmt: skip


def measurements(word: str, known: list[str] | None = None) -> tuple[WirelessMeasurement, ...]:
    (source,) = sources_of_words([word])
    return read_radio(source, known).log.measurements


def example(store: Any, msgtype: str) -> Any:  # noqa: PLR0911  -- a table of messages
    """A message in which tag 1 measured tag 2 at 3.5 m."""
    new = store.types[msgtype]
    if msgtype == "nlink_parser/msg/LinktrackNodeframe2":
        node = store.types["nlink_parser/msg/LinktrackNode2"](role=2, id=2, dis=3.5, fp_rssi=0, rx_rssi=0)
        zeros = np.zeros(3, np.float32)
        return new(role=2, id=1, local_time=0, system_time=0, voltage=5, pos_3d=zeros, nodes=[node])
    if msgtype == "nlink_parser/msg/LinktrackAoaNodeframe0":
        node = store.types["nlink_parser/msg/LinktrackAoaNode0"](role=2, id=2, dis=3.5, angle=20, fp_rssi=0)
        return new(role=2, id=1, nodes=[node])
    if msgtype == "dwm1001c_ros/msg/UWBMeas":
        place = store.types["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0)
        return new(measurements=[store.types["dwm1001c_ros/msg/Anchor"](id="2", location=place, dist=3.5)])
    if msgtype == "uwb_msgs/msg/TwoWayRangeStamped":
        return new(header=header(store), range_raw=4.0, range_corr=3.5, rr=0.04, uwb_id1=1, uwb_id2=2)
    if msgtype == "uwb_msgs/msg/RangeStamped":
        return new(header=header(store), range=3.5, from_id=1, to_id=2, covariance=0.04, tx1=0)
    if msgtype == "gtec_msgs/msg/Ranging":
        return new(anchor_id=2, tag_id=1, range=3500, seq=0, rss=0.0)
    if msgtype == "inf_uwb_ros/msg/remote_uwb_info":
        return new(
            header=header(store), self_id=1, node_ids=np.array([2, 5], np.uint32),
            node_dis=np.array([3.5, 9], np.float32), active=np.array([True, False]),
        )  # fmt: skip
    one = store.types["mrs_msgs/msg/RangeWithCovarianceIdentified"](
        id=2, range=range_message(store, 3.5), variance=0.04
    )
    return new(header=header(store), ranges=[one])


@pytest.mark.parametrize("msgtype", sorted(MESSAGES))
def test_messages_of_drivers_are_read_by_their_presets(tmp_path: Path, msgtype: str) -> None:
    store = typestore(msgtype)
    preset = next(preset for preset in presets().values() if msgtype in preset.messages)
    if msgtype == "nlink_parser/msg/LinktrackAoaNodeframe0":
        assert preset.settings["range"] == "nodes[].dis"
    bag = write_bag(tmp_path / "bag", {"/radio": (msgtype, [example(store, msgtype)])}, store)
    own = ",receiver=alpha" if "from" not in preset.settings else ""
    (m,) = measurements(f"{bag},topic=/radio,robots.1=alpha,robots.2=beta{own}", ["alpha", "beta"])
    assert (m.receiver, m.transmitter, m.range_m) == ("alpha", "beta", 3.5)
    assert m.stamp_ns == START_NS + (0 if preset.settings["stamp"] == "header.stamp" else 7)
    assert m.range_sigma_m == pytest.approx(0.2 if "range_variance" in preset.settings else 0.5)


def test_the_message_that_the_issue_of_every_lab_has(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    text = "std_msgs/Header header\nuint32 distance_mm\nuint16 src_id\nuint16 dst_id\n"
    store.register(get_types_from_msg(text, "lab/msg/Uwb"))
    with Writer1(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/uwb", "lab/msg/Uwb", typestore=store)
        stamp = store.types["builtin_interfaces/msg/Time"](sec=1_700_000_000, nanosec=5)
        head = store.types["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id="")
        for distance in (20534, 20600):
            message = store.types["lab/msg/Uwb"](header=head, distance_mm=distance, src_id=7, dst_id=12)
            writer.write(connection, START_NS, store.serialize_ros1(message, "lab/msg/Uwb"))
    word = f"{tmp_path}/a.bag,topic=/uwb,stamp=header.stamp,range=distance_mm,unit=mm,from=src_id,to=dst_id"
    found = measurements(f"{word},robots.7=alpha,robots.12=beta")
    assert [(m.stamp_ns, m.receiver, m.transmitter, m.range_m) for m in found] == [
        (START_NS + 5, "alpha", "beta", 20.534),
        (START_NS + 5, "alpha", "beta", 20.6),
    ]
    with pytest.raises(InputError, match=r"lab/msg/Uwb has no field 'dist'.*distance_mm"):
        measurements(f"{tmp_path}/a.bag,topic=/uwb,range=dist,receiver=a,transmitter=b")
    assert measurements(f"{word},robots.7=alpha,robots.12=beta".replace("topic=/uwb", "topic=uwb")) == found
    with pytest.raises(InputError, match=r"name the field of the range .*its fields: .*header.stamp, .*distance_mm"):
        measurements(f"{tmp_path}/a.bag,topic=/uwb,receiver=a,transmitter=b")
    with pytest.raises(InputError, match="no topic /uwbb; it holds /uwb"):
        measurements(f"{tmp_path}/a.bag,topic=/uwbb")


def test_families_of_range_topics(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    topics = {
        f"/uwb/tof/n_{a}/n_{b}/distance": (
            RANGE, [range_message(store, a + b / 10), range_message(store, 0.1), range_message(store, 5, stamp_ns=0)]
        )
        for a, b in ((1, 2), (2, 3), (3, 9))
    }  # fmt: skip
    bag = write_bag(tmp_path / "bag", topics, store)
    word = f"{bag},topic=/uwb/tof/n_{{a}}/n_{{b}}/distance,robots.1=alpha,robots.2=beta,robots.3=gamma,anchors=9"
    found = measurements(word)
    assert [(m.receiver, m.transmitter, m.range_m) for m in found if m.stamp_ns == START_NS] == [
        ("alpha", "beta", pytest.approx(1.2)),
        ("beta", "gamma", pytest.approx(2.3)),
    ]
    assert {m.stamp_ns for m in found if m.range_m == 5} == {START_NS + 7 + 2 * 10**8}  # received: the stamp is zero


def test_the_bag_of_a_real_team(data_dir: Path) -> None:
    robots = ["turtle02", "turtle03", "turtle04", "turtle05"]
    found = measurements(f"{data_dir}/uwb_team_bag,preset=tiers", robots)
    pairs = {(m.receiver, m.transmitter) for m in found}
    assert pairs == {(a, b) for number, a in enumerate(robots) for b in robots[number + 1 :]}
    assert len(found) == 1007
    assert all(0.5 < (m.range_m or 0) < 10 for m in found)


def test_poses_are_ranges_and_bearings(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    t = store.types
    pose = t["geometry_msgs/msg/Pose"](
        position=t["geometry_msgs/msg/Point"](x=3.0, y=4.0, z=0.0),
        orientation=t["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    message = t["geometry_msgs/msg/PoseStamped"](header=header(store), pose=pose)
    bag = write_bag(tmp_path / "bag", {"/seen": ("geometry_msgs/msg/PoseStamped", [message])}, store)
    (m,) = measurements(f"{bag},topic=/seen,receiver=alpha,transmitter=beta")
    assert (m.range_m, m.paths[0].azimuth) == (5.0, pytest.approx(math.atan2(4, 3)))
    (m,) = measurements(f"{bag},topic=/seen,receiver=alpha,transmitter=beta,take=bearing")
    assert m.range_m is None


def test_what_is_not_used_is_said_with_what_to_add(tmp_path: Path, data_dir: Path) -> None:
    store = typestore("uwb_msgs/msg/RangeStamped", "nlink_parser/msg/LinktrackNodeframe2")
    bag = write_bag(
        tmp_path / "bag",
        {
            "/uwb/range": (RANGE, [range_message(store, 5.0, "uwb_alpha")] * 30),
            "/named": (RANGE, [range_message(store, 5.0, "alpha<-beta")]),
            "/radio": ("uwb_msgs/msg/RangeStamped", [example(store, "uwb_msgs/msg/RangeStamped")]),
        },
        store,
    )
    said = [radio.sentence(["beta"]) for radio in unused_radio(bag, [])]
    assert said == [
        "1 uwb_msgs/RangeStamped messages on /radio are not used: add to wireless:"
        " {topic: /radio, robots: {ID: NAME}} (preset decar)",
        "30 sensor_msgs/Range messages on /uwb/range are not used: frame_id 'uwb_alpha' names no pair of robots;"
        " if it is a radio's, add ranges: {/uwb/range: beta} to the robot",
    ]
    assert [radio.topic for radio in unused_radio(bag, ["/uwb/{to}"])] == ["/radio"]
    assert [radio.topic for radio in unused_radio(bag, ["/radio"])] == ["/uwb/range"]
    (family,) = unused_radio(data_dir / "uwb_team_bag", [])
    assert (family.topic, family.count, len(family.topics)) == ("/uwb/tof/n_{from}/n_{to}/distance", 4020, 28)


def test_paths_of_fields() -> None:
    with pytest.raises(ConfigError, match="two arrays"):
        FieldPath.parsed("a[].b[]")
    with pytest.raises(ConfigError, match="no field"):
        FieldPath.parsed("a..b")


def test_numbers_alone_on_a_topic_of_radio_are_said(tmp_path: Path) -> None:
    store = typestore()
    number = store.types["std_msgs/msg/Float32"]
    bag = write_bag(
        tmp_path / "bag",
        {
            "/uwb_range": ("std_msgs/msg/Float32", [number(data=3.5)] * 2),
            "/battery": ("std_msgs/msg/Float32", [number(data=12.0)]),
        },
        store,
    )
    (radio,) = unused_radio(bag, [])
    assert "{topic: /uwb_range, range: data, stamp: received, receiver: NAME, transmitter: NAME}" in radio.sentence([])
    with pytest.raises(InputError, match=r"no field 'header'.*add stamp: received"):
        measurements(f"{bag},topic=/uwb_range,range=data,receiver=a,transmitter=b")
    found = measurements(f"{bag},topic=/uwb_range,range=data,receiver=a,transmitter=b,stamp=received")
    assert [m.range_m for m in found] == [3.5, 3.5]


def test_one_range_for_an_entry(tmp_path: Path) -> None:
    store = typestore("uwb_msgs/msg/RangeStamped")
    message = example(store, "uwb_msgs/msg/RangeStamped")
    bag = write_bag(tmp_path / "bag", {"/radio": ("uwb_msgs/msg/RangeStamped", [message])}, store)
    source = RadioSource.model_validate({"path": bag, "topic": "/radio", "range": ["range", "covariance"]})
    with pytest.raises(InputError, match="range: names 2 fields; write one entry for each"):
        read_radio(source)


@pytest.mark.parametrize("tag", [np.array([222, 202, 0, 7], np.uint8), b"\xde\xca\x00\x07"])
def test_bytes_are_addresses(tag: object) -> None:
    source = RadioSource(path=Path("a"), robots={"DE:CA:00:07": "alpha"})
    assert TagNames(source, ["alpha"]).robot(tag) == "alpha"
