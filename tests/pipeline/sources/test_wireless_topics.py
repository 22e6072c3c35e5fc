"""Wireless messages in bags: round trip, ranges of other drivers, bad values."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from wiclosure.errors import InputError, OutputError
from wiclosure.pipeline.data.dataset_writer import write_ros1_bag, write_ros2_bag
from wiclosure.pipeline.sources.bags import topic_names
from wiclosure.pipeline.sources.messages.ros_types import MEASUREMENT_TYPE, typestore
from wiclosure.pipeline.sources.messages.wireless_messages import encode_header, encode_measurement
from wiclosure.pipeline.sources.open import open_source
from wiclosure.pipeline.sources.wireless_topics import RANGE_TYPE, read_wireless_topics
from wiclosure.types import AoaPath, Heading, Scan, WirelessLog, WirelessMeasurement

START_NS = 1_700_000_000_000_000_000
LOG = WirelessLog(
    (
        WirelessMeasurement(START_NS + 1, "alpha", "beta", 12.5, 0.3),
        WirelessMeasurement(
            START_NS + 250_000_001, "beta", "alpha",
            paths=(AoaPath(0.3, 0.1, 0.7, 0.05), AoaPath(-2.0, 0.2, 0.3)), aoa_frame="world",
            transmitter_stamp_ns=START_NS + 250_000_099,
            lever_arm_receiver=(0.1, -0.2, 0.3), lever_arm_transmitter=(0.0, 0.5, 1.0),
        ),
        WirelessMeasurement(START_NS + 400_000_000, "beta", "alpha", 3.25, 0.5, (AoaPath(1.0, 0.1),), "odometry"),
    ),
    (Heading(START_NS + 2, "alpha", 1.57, 0.05), Heading(START_NS + 300_000_000, "beta", -3.0, 0.1)),
)  # fmt: skip


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite3"])
@pytest.mark.parametrize("salvage", [False, True])
def test_wireless_messages_survive_beside_scans(tmp_path: Path, scans: list[Scan], kind: str, salvage: bool) -> None:
    path = tmp_path / "a.bag"
    if kind == "ros1":
        write_ros1_bag(path, scans, wireless=LOG)
    else:
        write_ros2_bag(path, scans, storage="mcap" if kind == "mcap" else "sqlite3", wireless=LOG)
    assert read_wireless_topics(path, salvage=salvage) == LOG
    assert [scan.stamp_ns for scan in open_source(path, salvage=salvage)] == [scan.stamp_ns for scan in scans]


def test_a_bag_without_wireless_topics_is_silent(bags: dict[str, Path]) -> None:
    assert read_wireless_topics(bags["ros1"]) == WirelessLog()


def ranges(store: Any, frame_id: str, values: list[float], **extra: Any) -> list[Any]:
    return [
        store.types[RANGE_TYPE](
            header=encode_header(START_NS + number, store, frame_id),
            radiation_type=0, field_of_view=0.1, min_range=0.2, max_range=100.0, range=value, **extra,
        )
        for number, value in enumerate(values)
    ]  # fmt: skip


@pytest.fixture
def range_bag(tmp_path: Path) -> Path:
    store = typestore("ros1")
    with Writer1(tmp_path / "r.bag") as writer:
        for topic, frame_id in (("/uwb", "alpha<-beta"), ("/sonar", "base_link"), ("/uwb_gamma", "tag_7")):
            connection = writer.add_connection(topic, RANGE_TYPE, typestore=store)
            for message in ranges(store, frame_id, [4.0, math.inf, 0.1, 150.0, math.nan, 5.5]):
                writer.write(connection, START_NS, store.serialize_ros1(message, RANGE_TYPE))
    return tmp_path / "r.bag"


def test_ranges_whose_frame_names_the_robots(range_bag: Path) -> None:
    log = read_wireless_topics(range_bag)
    assert [(m.receiver, m.transmitter, m.range_m, m.stamp_ns - START_NS) for m in log.measurements] == [
        ("alpha", "beta", 4.0, 0),
        ("alpha", "beta", 5.5, 5),
    ]


def test_ranges_whose_robots_the_caller_names(range_bag: Path) -> None:
    log = read_wireless_topics(range_bag, range_topics={"/uwb_gamma": ("alpha", "gamma")})
    assert {(m.receiver, m.transmitter) for m in log.measurements} == {("alpha", "beta"), ("alpha", "gamma")}
    with pytest.raises(InputError, match="no topic /wrong"):
        read_wireless_topics(range_bag, range_topics={"/wrong": ("a", "b")})


def test_the_variance_of_newer_ros_versions_is_used(tmp_path: Path) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    with Writer2(tmp_path / "r", version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/uwb", RANGE_TYPE, typestore=store)
        for message in ranges(store, "alpha<-beta", [4.0], variance=0.04):
            writer.write(connection, START_NS, store.serialize_cdr(message, RANGE_TYPE))
    (measurement,) = read_wireless_topics(tmp_path / "r").measurements
    assert measurement.range_sigma_m == pytest.approx(0.2)


def test_an_impossible_value_is_named(tmp_path: Path) -> None:
    store = typestore("ros1")
    message: Any = encode_measurement(LOG.measurements[0], store)
    message.range = -1.0
    with Writer1(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/w", MEASUREMENT_TYPE, typestore=store)
        writer.write(connection, 1, store.serialize_ros1(message, MEASUREMENT_TYPE))
    with pytest.raises(InputError, match=r"a\.bag, topic /w, message 0: range is -1\.0"):
        read_wireless_topics(tmp_path / "a.bag")


def test_writers_leave_nothing_unfinished(tmp_path: Path, scans: list[Scan]) -> None:
    late = Scan(2**31 * 10**9, np.ones((3, 3)))
    for write, name in ((write_ros1_bag, "a.bag"), (write_ros2_bag, "b")):
        with pytest.raises(OutputError, match="does not fit a ROS time"):
            write(tmp_path / name, [*scans, late])
        assert list(tmp_path.iterdir()) == []
        write(tmp_path / name, scans)
        with pytest.raises(OutputError, match="exists already"):
            write(tmp_path / name, scans)
        for path in tmp_path.iterdir():
            path.rename(tmp_path.parent / f"{tmp_path.name}_{name}")


def test_topics_that_are_to_be_left_out(range_bag: Path, tmp_path: Path, scans: list[Scan]) -> None:
    assert read_wireless_topics(range_bag, ignored=["/uwb"]) == WirelessLog()
    with pytest.raises(InputError, match="no topic /wrong; it holds /sonar"):
        read_wireless_topics(range_bag, ignored=["/wrong"])
    write_ros1_bag(tmp_path / "own.bag", scans, wireless=LOG)
    own = set(topic_names(tmp_path / "own.bag")) - {"/points"}
    assert read_wireless_topics(tmp_path / "own.bag", ignored=own) == WirelessLog()
