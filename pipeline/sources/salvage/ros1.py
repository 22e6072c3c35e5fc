"""Scans the records of a ROS 1 bag (format 2.0) without its index."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from wiclosure.formats.unpacking import LARGEST_BLOCK, UnpackError, unpack
from wiclosure.pipeline.sources.salvage.found import (
    LARGEST_RECORD,
    ROS1_MAGIC,
    Damage,
    FoundMessage,
    FoundTopic,
    TopicChoice,
    everything,
)

_MESSAGE, _HEAD, _CHUNK, _CONNECTION = 2, 3, 5, 7


class _Record(NamedTuple):
    header: Mapping[str, bytes]
    data: bytes
    whole: bool  # False where the file ends within the data

    @property
    def operation(self) -> int:
        return self.header.get("op", b"\0")[0]


def scan_ros1(path: Path, damage: Damage, wanted: TopicChoice = everything) -> Iterator[FoundMessage]:
    """All whole messages, from whole and cut chunks alike.

    Args:
        path: the file.
        damage: takes down what is left out.
        wanted: of no meaning here: messages are in chunks, which are read whole.
    """
    topics: dict[bytes, FoundTopic] = {}
    with path.open("rb") as file:
        if file.read(len(ROS1_MAGIC)) != ROS1_MAGIC:
            damage("the file does not start as a ROS 1 bag")
            return
        for record in _records(file, path.stat().st_size):
            if record.operation == _HEAD and not any(record.header.get("index_pos", b"")):
                damage("the file was not closed by its recorder")
            if not record.whole:
                damage("the file ends within a record")
            if record.operation == _CHUNK:
                content = _chunk_content(record, damage)
                for inner in _records(BytesIO(content), len(content)):
                    yield from _message(inner, topics)
            else:
                yield from _message(record, topics)


def _message(record: _Record, topics: dict[bytes, FoundTopic]) -> Iterator[FoundMessage]:
    """The message of a message record; a connection record is remembered."""
    number = record.header.get("conn", b"")
    if not record.whole:
        return
    if record.operation == _CONNECTION and number not in topics:
        if topic := _topic(record):
            topics[number] = topic
    elif record.operation == _MESSAGE and number in topics and len(record.header.get("time", b"")) == 8:
        seconds, nanoseconds = struct.unpack("<LL", record.header["time"])
        yield FoundMessage(topics[number], seconds * 10**9 + nanoseconds, record.data)


def _topic(record: _Record) -> FoundTopic | None:
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
    from rosbags.typesys.msg import normalize_msgtype

    fields = _fields(record.data)
    if "topic" not in record.header or "type" not in fields:
        return None
    definition = fields.get("message_definition", b"").decode(errors="replace")
    name = "/" + "/".join(part for part in record.header["topic"].decode(errors="replace").split("/") if part)
    msgtype = normalize_msgtype(fields["type"].decode(errors="replace"))
    return FoundTopic(name, msgtype, MessageDefinition(MessageDefinitionFormat.MSG, definition), "ros1")


def _records(file: BinaryIO, size: int) -> Iterator[_Record]:
    """Records until the end, or until something that is none."""
    while (header := _sized(file, size)) is not None and header[1]:
        fields = _fields(header[0])
        data = _sized(file, size)
        if "op" not in fields or data is None:
            return
        yield _Record(fields, *data)


def _sized(file: BinaryIO, size: int) -> tuple[bytes, bool] | None:
    """Bytes preceded by their length, and whether all are there; None at the end."""
    length = file.read(4)
    if len(length) < 4:
        return None
    announced = int.from_bytes(length, "little")
    left = min(announced, size - file.tell())
    if left > LARGEST_RECORD:
        return None
    content = file.read(left)
    return content, len(content) == announced


def _fields(header: bytes) -> dict[str, bytes]:
    """The `name=value` fields of a record's header; what does not parse is left out."""
    fields, position = {}, 0
    while position + 4 <= len(header):
        length = int.from_bytes(header[position : position + 4], "little")
        name, equals, value = header[position + 4 : position + 4 + length].partition(b"=")
        if equals:
            fields[name.decode(errors="replace")] = value
        position += 4 + length
    return fields


def _chunk_content(record: _Record, damage: Damage) -> bytes:
    """What a chunk holds, as far as it decompresses."""
    compression = record.header.get("compression", b"none")
    if compression == b"none":
        return record.data
    announced = int.from_bytes(record.header.get("size", b""), "little") or LARGEST_BLOCK
    try:
        return unpack(
            record.data, "bz2" if compression == b"bz2" else "lz4", min(announced, LARGEST_BLOCK), partly=True
        )
    except UnpackError as error:
        damage(f"a chunk cannot be unpacked: {error}")
        return b""
