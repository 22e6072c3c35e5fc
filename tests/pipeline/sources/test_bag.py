from __future__ import annotations

import logging

import pytest
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

from wiclosure.formats.unpacking import zstd
from wiclosure.pipeline.sources.bag import counted_topics, decompressed, same_topic
from wiclosure.pipeline.sources.salvage.found import FoundTopic


def topic(name: str, msgtype: str = "std_msgs/msg/String", definition: str = "", encoding: str = "cdr") -> FoundTopic:
    return FoundTopic(name, msgtype, MessageDefinition(MessageDefinitionFormat.MSG, definition), encoding)


def test_messages_of_a_topic_are_counted_over_all_its_descriptions() -> None:
    found = counted_topics([(topic("/b"), 2), (topic("/a", definition="string data"), 3), (topic("/a"), 4)])
    assert {name: of.count for name, of in found.items()} == {"/a": 7, "/b": 2}
    assert found["/a"].found.definition.data == "string data"


def test_of_two_types_on_one_name_the_one_with_more_messages_is_read(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        found = counted_topics([(topic("/a", "pkg/msg/Old"), 9), (topic("/a", "pkg/msg/New"), 2)])
    assert (found["/a"].msgtype, found["/a"].count) == ("pkg/msg/Old", 9)
    assert "topic /a has messages of several types; those of pkg/msg/Old are read" in caplog.text


def test_topics_are_alike_whatever_their_definitions() -> None:
    assert same_topic(topic("/a"), topic("/a", definition="string data"))
    assert not same_topic(topic("/a"), topic("/a", encoding="ros1"))
    assert not same_topic(topic("/a"), topic("/b"))


def test_compressed_messages_are_unpacked_and_others_left_alone() -> None:
    assert decompressed(zstd.compress(b"hello" * 9)) == b"hello" * 9
    assert decompressed(b"\0\1\0\0hello") == b"\0\1\0\0hello"
