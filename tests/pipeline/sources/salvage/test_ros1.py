from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer

from wiclosure.pipeline.data.dataset_writer import write_ros1_bag
from wiclosure.pipeline.sources.salvage.found import ROS1_MAGIC, Damage
from wiclosure.pipeline.sources.salvage.ros1 import scan_ros1


def found(path: Path) -> tuple[list[int], list[str]]:
    damage = Damage()
    return [message.stamp_ns for message in scan_ros1(path, damage)], damage.found


@pytest.mark.parametrize("compression", [None, *Writer.CompressionFormat])
def test_chunks_of_every_compression(recordings: dict[str, Path], tmp_path: Path, compression) -> None:
    from rosbags.rosbag1 import Reader

    path = tmp_path / "a.bag"
    writer = Writer(path)
    if compression is not None:
        writer.set_compression(compression)
    with Reader(recordings["ros1"]) as reader, writer:
        (connection,) = reader.connections
        definition, md5 = connection.msgdef.data, connection.digest
        added = writer.add_connection(connection.topic, connection.msgtype, msgdef=definition, md5sum=md5)
        for _, stamp_ns, raw in reader.messages():
            writer.write(added, stamp_ns, raw)
    assert found(path) == found(recordings["ros1"])
    assert len(found(path)[0]) == 12


def test_a_bag_that_was_not_closed_is_read_and_said_to_be_so(recordings: dict[str, Path], tmp_path: Path) -> None:
    content = recordings["ros1"].read_bytes()
    at = content.index(b"index_pos=") + len(b"index_pos=")
    (tmp_path / "a.bag").write_bytes(content[:at] + bytes(8) + content[at + 8 :])
    stamps_ns, damage = found(tmp_path / "a.bag")
    assert len(stamps_ns) == 12
    assert damage == ["the file was not closed by its recorder"]


def test_a_chunk_that_does_not_decompress_costs_its_own_messages_only(tmp_path: Path) -> None:
    from wiclosure.types import Scan

    scans = [Scan(10**18 + k * 10**8, np.random.default_rng(k).normal(0, 9, (30_000, 3))) for k in range(6)]
    write_ros1_bag(tmp_path / "a.bag", scans)
    content = bytearray((tmp_path / "a.bag").read_bytes())
    at = content.index(b"compression=none")
    content[at : at + 16] = b"compression=gone"
    (tmp_path / "a.bag").write_bytes(content)
    stamps_ns, damage = found(tmp_path / "a.bag")
    assert len(stamps_ns) < 6
    assert damage


def test_another_file_holds_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.bag").write_bytes(b"#ROSBAG V1.2\n" + bytes(100))
    assert found(tmp_path / "a.bag") == ([], ["the file does not start as a ROS 1 bag"])
    (tmp_path / "a.bag").write_bytes(ROS1_MAGIC)
    assert found(tmp_path / "a.bag")[0] == []
