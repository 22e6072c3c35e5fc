"""Scans the records of an MCAP file without its summary."""

from __future__ import annotations

import struct
from binascii import crc32
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from wiclosure.formats.unpacking import LARGEST_BLOCK, UnpackError, unpack
from wiclosure.pipeline.sources.salvage.found import (
    LARGEST_RECORD,
    MCAP_MAGIC,
    Damage,
    FoundMessage,
    FoundTopic,
    TopicChoice,
    everything,
)

if TYPE_CHECKING:
    from rosbags.interfaces import MessageDefinition

_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
_MESSAGE_HEAD = 22  # bytes before a message's data: channel, sequence, two times


@dataclass
class _Known:
    """Schemas and channels met so far."""

    damage: Damage
    schemas: dict[int, tuple[str, MessageDefinition]] = field(default_factory=dict)
    topics: dict[int, FoundTopic] = field(default_factory=dict)


def scan_mcap(path: Path, damage: Damage, wanted: TopicChoice = everything) -> Iterator[FoundMessage]:
    """All whole messages, from whole and cut chunks alike, in the order of the file.

    Args:
        path: the file.
        damage: takes down what is left out.
        wanted: data of other topics' messages outside of chunks are skipped: they come out empty.
    """
    known = _Known(damage)
    with path.open("rb") as file:
        if file.read(len(MCAP_MAGIC)) != MCAP_MAGIC:
            damage("the file does not start as an MCAP file")
            return
        operation = 0
        for operation, content, whole in _records(file, path.stat().st_size, known, wanted):
            if operation == _FOOTER:
                break
            if not whole:
                damage("the file ends within a record")
            if operation == _CHUNK:
                inner = _chunk_content(content, damage)
                for inner_operation, record, inner_whole in _records(BytesIO(inner), len(inner)):
                    if inner_whole:
                        yield from _message(inner_operation, record, known)
            elif whole:
                yield from _message(operation, content, known)
        if operation != _FOOTER:
            damage("the file was not closed by its recorder")


def _records(
    file: BinaryIO, size: int, known: _Known | None = None, wanted: TopicChoice = everything
) -> Iterator[tuple[int, bytes, bool]]:
    """Operation, content and whether it is whole, of each record; of messages that are not wanted, the head alone."""
    while len(head := file.read(9)) == 9 and head[0]:
        length = int.from_bytes(head[1:], "little")
        whole = file.tell() + length <= size
        left = min(length, size - file.tell())
        if left > LARGEST_RECORD:
            if known is not None:
                known.damage(f"a record of {left >> 20} MB was left out")
            file.seek(left, 1)
            continue
        content = file.read(min(left, _MESSAGE_HEAD) if head[0] == _MESSAGE else left)
        left -= len(content)
        topic = known.topics.get(int.from_bytes(content[:2], "little")) if known is not None and left else None
        if topic is not None and whole and not wanted(topic):
            file.seek(left, 1)
        else:
            content += file.read(left)
        yield head[0], content, whole


def _message(operation: int, record: bytes, known: _Known) -> Iterator[FoundMessage]:
    """The message of a message record; schemas and channels are remembered."""
    try:
        if operation == _SCHEMA:
            _remember_schema(record, known)
        elif operation == _CHANNEL:
            _remember_channel(record, known)
        elif operation == _MESSAGE:
            channel, _, log_time_ns = struct.unpack_from("<HIQ", record)
            if channel in known.topics:
                yield FoundMessage(known.topics[channel], log_time_ns, record[_MESSAGE_HEAD:])
            else:
                known.damage(f"a message belongs to channel {channel}, which is described nowhere")
    except (struct.error, UnicodeDecodeError) as error:
        known.damage(f"a record cannot be read: {error}")


def _remember_schema(record: bytes, known: _Known) -> None:
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    (number,) = struct.unpack_from("<H", record)
    name, encoding = _strings(record, 2, 2)
    if encoding in {"ros1msg", "ros2msg"}:
        (text,) = _strings(record, 2 + 4 + len(name.encode()) + 4 + len(encoding.encode()), 1)
        definition = MessageDefinition(MessageDefinitionFormat.MSG, text)
    else:  # perhaps no text: descriptions of protobuf messages are binary
        definition = MessageDefinition(MessageDefinitionFormat.NONE, "")
    known.schemas[number] = (name, definition)


def _remember_channel(record: bytes, known: _Known) -> None:
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
    from rosbags.typesys.msg import normalize_msgtype

    number, schema = struct.unpack_from("<HH", record)
    topic, encoding = _strings(record, 4, 2)
    msgtype, definition = known.schemas.get(schema, ("unknown", MessageDefinition(MessageDefinitionFormat.NONE, "")))
    if encoding in {"cdr", "ros1"} and msgtype.count("/") == 1:
        msgtype = normalize_msgtype(msgtype)
    known.topics[number] = FoundTopic(topic, msgtype, definition, encoding)


def _strings(record: bytes, position: int, count: int) -> list[str]:
    """Consecutive strings, each preceded by its length."""
    strings = []
    for _ in range(count):
        (length,) = struct.unpack_from("<I", record, position)
        strings.append(record[position + 4 : position + 4 + length].decode())
        position += 4 + length
    return strings


def _chunk_content(chunk: bytes, damage: Damage) -> bytes:
    """What a chunk holds, as far as it decompresses."""
    try:
        uncompressed_size, crc = struct.unpack_from("<QI", chunk, 16)
        (compression,) = _strings(chunk, 28, 1)
        content = _decompressed(chunk[28 + 4 + len(compression) + 8 :], compression, uncompressed_size)
    except (struct.error, ValueError, UnpackError) as error:
        damage(f"a chunk cannot be unpacked: {error}")
        return b""
    if len(content) != uncompressed_size:
        damage(f"a chunk holds {len(content)} bytes of {uncompressed_size}")
    elif crc and crc32(content) != crc:
        damage("a chunk's checksum does not fit")
    return content


def _decompressed(packed: bytes, compression: str, size: int) -> bytes:
    if compression == "zstd":
        return unpack(packed, "zstd", min(size, LARGEST_BLOCK), partly=True)
    if compression == "lz4":
        return unpack(packed, "lz4", min(size, LARGEST_BLOCK), partly=True)
    if compression:
        raise ValueError(f"unknown compression {compression!r}")
    return packed
