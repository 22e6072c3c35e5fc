"""MCAP files of any form, as other writers than rosbags leave them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import NamedTuple

MAGIC = b"\x89MCAP0\r\n"


class Topic(NamedTuple):
    """A channel with its messages: log time, data."""

    name: str
    msgtype: str
    messages: Sequence[tuple[int, bytes]]
    encoding: str = "cdr"
    schema_encoding: str = "ros2msg"
    definition: bytes = b""


def string(text: bytes | str) -> bytes:
    raw = text.encode() if isinstance(text, str) else text
    return struct.pack("<I", len(raw)) + raw


def record(operation: int, content: bytes) -> bytes:
    return struct.pack("<BQ", operation, len(content)) + content


def mcap_bytes(topics: Sequence[Topic], *, chunked: bool = False, profile: str = "ros2", footer: bool = True) -> bytes:
    """A file without summary; messages in the order of their topics' numbers, chunked or not."""
    body = b""
    for number, topic in enumerate(topics, start=1):
        schema = struct.pack("<H", number) + string(topic.msgtype) + string(topic.schema_encoding)
        body += record(3, schema + string(topic.definition))
        channel = struct.pack("<HH", number, number) + string(topic.name) + string(topic.encoding)
        body += record(4, channel + string(b""))
    longest = max((len(topic.messages) for topic in topics), default=0)
    for row in range(longest):
        for number, topic in enumerate(topics, start=1):
            if row < len(topic.messages):
                log_ns, data = topic.messages[row]
                body += record(5, struct.pack("<HIQQ", number, row, log_ns, log_ns) + data)
    if chunked:
        body = record(
            6, struct.pack("<QQQI", 0, 2**62, len(body), 0) + string("") + struct.pack("<Q", len(body)) + body
        )
    head = MAGIC + record(1, string(profile) + string("a test"))
    tail = record(15, struct.pack("<I", 0)) + record(2, struct.pack("<QQI", 0, 0, 0)) + MAGIC
    return head + body + (tail if footer else b"")
