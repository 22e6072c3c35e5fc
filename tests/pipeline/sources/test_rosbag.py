"""ROS bags: choice of topic, compression, damage and salvage, what `info` says."""

from __future__ import annotations

import shutil
import sqlite3
import tracemalloc
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from backports import zstd
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from wiclosure.errors import InputError
from wiclosure.pipeline.data.dataset_writer import write_ros1_bag, write_ros2_bag
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.info import recording_info
from wiclosure.pipeline.sources.messages.pointcloud2_encoder import encode_scan
from wiclosure.pipeline.sources.messages.ros_types import POINT_CLOUD_TYPE, typestore
from wiclosure.pipeline.sources.open import open_source
from wiclosure.types import Scan

ROS1, ROS2 = typestore("ros1"), typestore("cdr")


def write_clouds(writer: Writer1 | Writer2, topics: dict[str, list[Scan]], store: Any = ROS1, other: str = "") -> None:
    """Clouds on several topics, and some headers on `other`."""
    serialize = store.serialize_ros1 if store is ROS1 else store.serialize_cdr
    if other:
        connection = writer.add_connection(other, "std_msgs/msg/Empty", typestore=store)
        writer.write(connection, 5, serialize(store.types["std_msgs/msg/Empty"](), "std_msgs/msg/Empty"))
    for topic, scans in topics.items():
        connection = writer.add_connection(topic, POINT_CLOUD_TYPE, typestore=store)
        for scan in scans:
            writer.write(connection, scan.stamp_ns, serialize(encode_scan(scan, store), POINT_CLOUD_TYPE))


def assert_same(read: list[Scan], scans: list[Scan]) -> None:
    assert [scan.stamp_ns for scan in read] == [scan.stamp_ns for scan in scans]
    for scan, original in zip(read, scans, strict=True):
        np.testing.assert_array_equal(scan.points, original.points)


# ------------------------------------------------------------------------------------------------------------- topics
@pytest.fixture
def two_topics(tmp_path: Path, scans: list[Scan]) -> Path:
    with Writer1(tmp_path / "two.bag") as writer:
        write_clouds(writer, {"/front/points": scans[:4], "/rear/points": scans[:2], "/idle": []}, other="/ping")
    return tmp_path / "two.bag"


def test_several_topics_are_listed_and_one_is_chosen(two_topics: Path, scans: list[Scan]) -> None:
    with pytest.raises(InputError) as caught:
        open_source(two_topics)
    for part in ("two.bag", "/front/points (4 messages)", "/rear/points (2 messages)", "--topic"):
        assert part in str(caught.value)
    assert_same(list(open_source(two_topics, topic="/rear/points")), scans[:2])
    assert len(open_source(two_topics, topic="front/points")) == 4


@pytest.mark.parametrize(
    ("topic", "says"),
    [
        ("/frnt/points", "did you mean /front/points"),
        ("/ping", "is of type std_msgs/msg/Empty"),
        ("/idle", "has no messages"),
        ("/nothing_like_it", r"its point clouds: .*/rear/points \(2 messages\)"),
    ],
)
def test_a_topic_that_cannot_be_used_is_named(two_topics: Path, topic: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as caught:
        open_source(two_topics, topic=topic)
    assert topic in str(caught.value)
    assert "two.bag" in str(caught.value)


def test_a_topic_without_messages_is_not_a_choice(tmp_path: Path, scans: list[Scan]) -> None:
    with Writer1(tmp_path / "a.bag") as writer:
        write_clouds(writer, {"/a": scans, "/b": []})
    assert len(open_source(tmp_path / "a.bag")) == len(scans)


def test_a_bag_without_clouds_or_messages(tmp_path: Path) -> None:
    with Writer1(tmp_path / "other.bag") as writer:
        write_clouds(writer, {}, other="/ping")
    with pytest.raises(InputError, match=r"no topic of point clouds.*/ping \(std_msgs/msg/Empty\)"):
        open_source(tmp_path / "other.bag")
    with Writer1(tmp_path / "empty.bag") as writer:
        write_clouds(writer, {})
    with pytest.raises(InputError, match="it is empty"):
        open_source(tmp_path / "empty.bag")
    with Writer1(tmp_path / "silent.bag") as writer:
        write_clouds(writer, {"/points": []}, other="/ping")
    with pytest.raises(InputError, match=r"topic /points of .* has no messages"):
        open_source(tmp_path / "silent.bag")


# -------------------------------------------------------------------------------------------------------- compression
@pytest.mark.parametrize("how", [Writer1.CompressionFormat.BZ2, Writer1.CompressionFormat.LZ4])
@pytest.mark.parametrize("salvage", [False, True])
def test_compressed_ros1(tmp_path: Path, scans: list[Scan], how: Writer1.CompressionFormat, salvage: bool) -> None:
    writer = Writer1(tmp_path / "a.bag")
    writer.set_compression(how)
    with writer:
        write_clouds(writer, {"/points": scans})
    assert_same(list(open_source(tmp_path / "a.bag", salvage=salvage)), scans)


@pytest.mark.parametrize("metadata", [True, False])
@pytest.mark.parametrize("salvage", [False, True])
@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
    ],
)
def test_compressed_ros2(
    tmp_path: Path, scans: list[Scan], storage: StoragePlugin, mode: CompressionMode, metadata: bool, salvage: bool
) -> None:
    writer = Writer2(tmp_path / "a", version=8, storage_plugin=storage)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        write_clouds(writer, {"/points": scans}, ROS2)
    if not metadata:
        (tmp_path / "a" / "metadata.yaml").unlink()
    assert_same(list(open_source(tmp_path / "a", salvage=salvage)), scans)


def test_a_split_bag_is_read_in_order_of_its_numbers(tmp_path: Path, scans: list[Scan]) -> None:
    folder = tmp_path / "split"
    folder.mkdir()
    for number, scan in enumerate(scans):
        with Writer1(folder / f"run_{number + 7}.bag") as writer:
            write_clouds(writer, {"/points": [scan]})
    assert_same(list(open_source(folder)), scans)
    assert_same(list(open_source(folder, salvage=True)), scans)


@pytest.mark.parametrize("names", [("alpha", "beta"), ("robot1", "robot2")])
def test_bags_of_several_robots_in_one_folder_are_not_one_recording(
    tmp_path: Path, scans: list[Scan], names: tuple[str, str]
) -> None:
    slow = [Scan(scan.stamp_ns + number * 10**9, scan.points) for number, scan in enumerate(scans)]
    for name in names:
        with Writer1(tmp_path / f"{name}.bag") as writer:
            write_clouds(writer, {"/points": slow})
    with pytest.raises(InputError, match=rf"several recordings: {names[0]}\.bag, {names[1]}\.bag; name one"):
        open_source(tmp_path)


# ------------------------------------------------------------------------------------------------- damage and salvage
def cut(path: Path, target: Path, share: float) -> Path:
    content = path.read_bytes()
    target.write_bytes(content[: int(len(content) * share)])
    return target


@pytest.fixture(scope="module")
def long_bags(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Path], list[Scan]]:
    """Bags of many chunks of about a megabyte."""
    rng = np.random.default_rng(0)
    points = rng.normal(0, 20, (12_000, 3)).astype(np.float32).astype(float)
    scans = [Scan(10**18 + number * 10**8, points + number) for number in range(24)]
    scans = [Scan(scan.stamp_ns, scan.points.astype(np.float32).astype(float)) for scan in scans]
    folder = tmp_path_factory.mktemp("long")
    for name, how in (("none", None), ("bz2", Writer1.CompressionFormat.BZ2), ("lz4", Writer1.CompressionFormat.LZ4)):
        writer1 = Writer1(folder / f"{name}.bag")
        if how is not None:
            writer1.set_compression(how)
        with writer1:
            write_clouds(writer1, {"/points": scans})
    for name, plugin, mode in (
        ("mcap", StoragePlugin.MCAP, CompressionMode.NONE),
        ("zstd", StoragePlugin.MCAP, CompressionMode.STORAGE),
        ("db3", StoragePlugin.SQLITE3, CompressionMode.NONE),
    ):
        writer2 = Writer2(folder / name, version=8, storage_plugin=plugin)
        writer2.set_compression(mode, CompressionFormat.ZSTD)
        with writer2:
            write_clouds(writer2, {"/points": scans}, ROS2)
    files = {name: folder / f"{name}.bag" for name in ("none", "bz2", "lz4")}
    files |= {name: folder / name / f"{name}.mcap" for name in ("mcap", "zstd")} | {"db3": folder / "db3" / "db3.db3"}
    return files, scans


@pytest.mark.parametrize("kind", ["none", "bz2", "lz4", "mcap", "zstd", "db3"])
@pytest.mark.parametrize("share", [0.62, 0.97])
def test_a_truncated_bag_says_what_can_be_read_and_salvage_reads_it(
    tmp_path: Path, long_bags: tuple[dict[str, Path], list[Scan]], kind: str, share: float
) -> None:
    files, scans = long_bags
    path = cut(files[kind], tmp_path / files[kind].name, share)
    with pytest.raises(InputError) as caught:
        list(open_source(path))
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    assert "--salvage" in message
    read = list(open_source(path, salvage=True))
    assert f"{len(read)} messages can be read ({len(read)} on /points)" in message
    assert len(open_source(path, salvage=True)) == len(read)
    assert len(scans) * share - 7 <= len(read) <= len(scans) * share + 1
    assert_same(read, scans[: len(read)])


def test_a_bag_whose_recorder_was_killed_has_no_index(tmp_path: Path, scans: list[Scan]) -> None:
    writer = Writer1(tmp_path / "a.bag.active")
    writer.open()
    write_clouds(writer, {"/points": scans})
    writer.write_chunk(writer.chunks[-1])
    writer.abort()
    with pytest.raises(InputError, match=r"6 messages can be read.*--salvage"):
        open_source(tmp_path / "a.bag.active")
    assert_same(list(open_source(tmp_path / "a.bag.active", salvage=True)), scans)


def test_a_folder_with_a_truncated_file(tmp_path: Path, long_bags: tuple[dict[str, Path], list[Scan]]) -> None:
    files, scans = long_bags
    shutil.copytree(files["mcap"].parent, tmp_path / "mcap")
    cut(files["mcap"], tmp_path / "mcap" / "mcap.mcap", 0.5)
    with pytest.raises(InputError, match="--salvage"):
        open_source(tmp_path / "mcap")
    read = list(open_source(tmp_path / "mcap", salvage=True))
    assert 6 <= len(read) <= 13
    assert_same(read, scans[: len(read)])


@pytest.mark.parametrize("kind", ["bz2", "lz4", "zstd"])
def test_a_damaged_chunk_in_the_middle_is_left_out_when_salvaging(
    tmp_path: Path, long_bags: tuple[dict[str, Path], list[Scan]], kind: str
) -> None:
    files, scans = long_bags
    content = bytearray(files[kind].read_bytes())
    middle = len(content) // 2
    content[middle : middle + 2000] = bytes(2000)
    path = tmp_path / files[kind].name
    path.write_bytes(content)
    with pytest.raises(InputError, match="--salvage"):
        list(open_source(path))
    stamps = [scan.stamp_ns for scan in open_source(path, salvage=True)]
    assert len(scans) - 8 <= len(stamps) < len(scans)
    assert stamps[-1] == scans[-1].stamp_ns


def test_sqlite_messages_in_the_write_ahead_log_are_not_lost(tmp_path: Path, bags: dict[str, Path]) -> None:
    source = next(bags["sqlite3"].glob("*.db3"))
    work = tmp_path / "work.db3"
    shutil.copy(source, work)
    database = sqlite3.connect(work)
    database.execute("PRAGMA journal_mode=WAL")
    database.execute("INSERT INTO messages SELECT id + 100, topic_id, timestamp + 1000, data FROM messages")
    database.commit()
    for file in tmp_path.glob("work.db3*"):  # as they are while the recorder is killed
        shutil.copy(file, tmp_path / file.name.replace("work", "killed"))
    database.close()
    with pytest.raises(InputError, match=r"not closed.*12 messages can be read.*--salvage"):
        open_source(tmp_path / "killed.db3")
    assert len(open_source(tmp_path / "killed.db3", salvage=True)) == 12


@pytest.mark.parametrize("head", [b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0"])
@pytest.mark.parametrize("salvage", [False, True])
def test_only_a_head_holds_nothing(tmp_path: Path, head: bytes, salvage: bool) -> None:
    path = tmp_path / "head.bag"
    path.write_bytes(head)
    with pytest.raises(InputError, match=r"head\.bag.*no whole message"):
        open_source(path, salvage=salvage)


def test_random_damage_never_raises_anything_else(
    tmp_path: Path, long_bags: tuple[dict[str, Path], list[Scan]]
) -> None:
    rng = np.random.default_rng(1)
    for kind, file in long_bags[0].items():
        content = np.fromfile(file, np.uint8)[:700_000]
        for attempt in range(3):
            spoiled = content.copy()
            places = rng.integers(0, len(spoiled) if attempt else 5000, 40)
            spoiled[places] = rng.integers(0, 256, 40)
            path = tmp_path / f"{kind}{attempt}{file.suffix}"
            spoiled.tofile(path)
            for salvage in (False, True):
                error = error_of(path, salvage)
                assert error is None or str(path) in error


def error_of(path: Path, salvage: bool) -> str | None:
    try:
        list(open_source(path, salvage=salvage))
    except InputError as error:
        return str(error)
    return None


def test_a_message_that_is_no_cloud_is_named(tmp_path: Path, scans: list[Scan]) -> None:
    with Writer1(tmp_path / "a.bag") as writer:
        connection = writer.add_connection("/points", POINT_CLOUD_TYPE, typestore=ROS1)
        good = ROS1.serialize_ros1(encode_scan(scans[0], ROS1), POINT_CLOUD_TYPE)
        writer.write(connection, 1, good)
        writer.write(connection, 2, good[: len(good) // 2])
        writer.write(connection, 3, ROS1.serialize_ros1(encode_scan(scans[1], ROS1), POINT_CLOUD_TYPE))
    with pytest.raises(InputError, match=r"a\.bag, topic /points, message 1"):
        list(open_source(tmp_path / "a.bag"))
    assert len(list(open_source(tmp_path / "a.bag", salvage=True))) == 2


def test_a_damaged_compressed_message_is_named_or_left_out(tmp_path: Path, scans: list[Scan]) -> None:
    writer = Writer2(tmp_path / "a", version=8, storage_plugin=StoragePlugin.SQLITE3)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        write_clouds(writer, {"/points": scans}, ROS2)
    with closing(sqlite3.connect(tmp_path / "a" / "a.db3")) as database, database:
        database.execute("UPDATE messages SET data = substr(data, 1, 99) WHERE id = 3")
    with pytest.raises(InputError, match="--salvage"):
        list(open_source(tmp_path / "a"))
    assert_same(list(open_source(tmp_path / "a", salvage=True)), [*scans[:2], *scans[3:]])


def test_a_folder_whose_files_are_gone(tmp_path: Path, bags: dict[str, Path]) -> None:
    shutil.copytree(bags["mcap"], tmp_path / "a")
    next((tmp_path / "a").glob("*.mcap")).unlink()
    with pytest.raises(InputError, match="missing"):
        open_source(tmp_path / "a")


# --------------------------------------------------------------------------------------------------------------- info
@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite3"])
def test_info_of_a_bag(bags: dict[str, Path], kind: str, scans: list[Scan]) -> None:
    info = recording_info(bags[kind])
    assert info.count == len(scans)
    assert info.start_ns == scans[0].stamp_ns
    assert info.duration_s == pytest.approx(0.5)
    assert info.bytes_on_disk > 6 * 300 * 20
    (topic,) = info.topics
    assert (topic.name, topic.msgtype, topic.count) == ("/points", POINT_CLOUD_TYPE, 6)
    assert topic.first_cloud is not None
    assert [field.name for field in topic.first_cloud.fields] == ["x", "y", "z", "intensity", "time"]
    assert topic.first_cloud.times == pytest.approx((0, 0.1))
    assert topic.first_cloud.returns == 300


def test_info_of_an_empty_bag(tmp_path: Path) -> None:
    with Writer1(tmp_path / "a.bag") as writer:
        write_clouds(writer, {"/points": []}, other="")
    info = recording_info(tmp_path / "a.bag")
    assert info.start_ns is None
    assert info.duration_s == 0


def test_an_mcap_of_another_writer_is_read(tmp_path: Path, bags: dict[str, Path], scans: list[Scan]) -> None:
    content = next(bags["mcap"].glob("*.mcap")).read_bytes()
    path = tmp_path / "other.mcap"
    path.write_bytes(content.replace(b"\4\0\0\0ros2", b"\4\0\0\0none", 1))
    assert_same(list(open_source(path)), scans)


@pytest.mark.parametrize("opened", [open_bag, lambda p: open_bag(p, salvage=True)])
def test_messages_of_any_topic(two_topics: Path, opened: Callable[[Path], Any]) -> None:
    with opened(two_topics) as bag:
        assert len(list(bag.messages("/ping"))) == 1
        assert [topic.count for topic in bag.topics.values() if topic.msgtype == POINT_CLOUD_TYPE and topic.count] == [
            4,
            2,
        ]


def test_zstd_file_on_its_own(tmp_path: Path, bags: dict[str, Path], scans: list[Scan]) -> None:
    packed = tmp_path / "a.mcap.zstd"
    packed.write_bytes(zstd.compress(next(bags["mcap"].glob("*.mcap")).read_bytes()))
    assert_same(list(open_source(packed)), scans)


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite3"])
def test_one_scan_is_in_memory_at_a_time(tmp_path: Path, kind: str) -> None:
    points = np.random.default_rng(0).normal(0, 20, (50_000, 3))
    peaks = []
    for count in (10, 40):
        stream = (Scan((number + 1) * 10**8, points) for number in range(count))
        path = tmp_path / f"{count}"
        if kind == "ros1":
            write_ros1_bag(path, stream)
        else:
            write_ros2_bag(path, stream, storage="mcap" if kind == "mcap" else "sqlite3")
        tracemalloc.start()
        assert sum(1 for _ in open_source(path)) == count
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < peaks[0] + 600_000  # one scan is 600 kB as recorded, twice that when decoded
