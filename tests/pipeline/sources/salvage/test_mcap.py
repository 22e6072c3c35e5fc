from __future__ import annotations

import struct
from pathlib import Path

import pytest

from wiclosure.pipeline.sources.salvage.found import MCAP_MAGIC, Damage
from wiclosure.pipeline.sources.salvage.mcap import scan_mcap

from ..mcap_bytes import Topic, mcap_bytes, record  # noqa: TID252  -- test folders are no packages

CLOUDS = Topic("/points", "sensor_msgs/msg/PointCloud2", [(10, b"first" * 9), (30, b"third" * 9)])
STRINGS = Topic("/words", "std_msgs/msg/String", [(20, b"second")], "json", "jsonschema")


def found(path: Path, **options) -> tuple[list[tuple[str, int, bytes]], list[str]]:
    damage = Damage()
    return [(m.topic.name, m.stamp_ns, m.data) for m in scan_mcap(path, damage, **options)], damage.found


@pytest.fixture
def write(tmp_path: Path):
    def write(content: bytes) -> Path:
        (tmp_path / "a.mcap").write_bytes(content)
        return tmp_path / "a.mcap"

    return write


@pytest.mark.parametrize("chunked", [False, True])
def test_every_message_with_its_topic_type_and_encoding(write, chunked: bool) -> None:
    path = write(mcap_bytes([CLOUDS, STRINGS], chunked=chunked))
    messages, damage = found(path)
    assert messages == [("/points", 10, b"first" * 9), ("/words", 20, b"second"), ("/points", 30, b"third" * 9)]
    assert damage == []
    topics = {message.topic.name: message.topic for message in scan_mcap(path, Damage())}
    assert (topics["/points"].msgtype, topics["/points"].encoding) == ("sensor_msgs/msg/PointCloud2", "cdr")
    assert topics["/words"].encoding == "json"


def test_a_file_without_its_end_is_read_and_said_to_be_so(write) -> None:
    messages, damage = found(write(mcap_bytes([CLOUDS], footer=False)))
    assert len(messages) == 2
    assert damage == ["the file was not closed by its recorder"]


def test_data_of_topics_that_are_not_wanted_are_skipped(write) -> None:
    messages, damage = found(write(mcap_bytes([CLOUDS, STRINGS])), wanted=lambda topic: topic.name == "/words")
    assert ("/words", 20, b"second") in messages
    assert [data for name, _, data in messages if name == "/points"] == [b"", b""]
    assert damage == []


def test_a_message_of_an_unknown_channel_is_taken_down(write) -> None:
    whole = mcap_bytes([CLOUDS], footer=False)
    messages, damage = found(write(whole + record(5, struct.pack("<HIQQ", 9, 0, 5, 5) + b"lost")))
    assert len(messages) == 2
    assert "a message belongs to channel 9, which is described nowhere" in damage


def test_a_chunk_of_an_unknown_compression_costs_what_is_in_it(write) -> None:
    chunk = struct.pack("<QQQI", 0, 1, 4, 0) + struct.pack("<I", 3) + b"xyz" + struct.pack("<Q", 4) + b"data"
    messages, damage = found(write(mcap_bytes([CLOUDS], footer=False) + record(6, chunk)))
    assert len(messages) == 2
    assert "a chunk cannot be unpacked: unknown compression 'xyz'" in damage


def test_another_file_holds_nothing(write) -> None:
    assert found(write(b"\x89MCAP1\r\n" + bytes(50))) == ([], ["the file does not start as an MCAP file"])
    assert found(write(MCAP_MAGIC)) == ([], ["the file was not closed by its recorder"])
