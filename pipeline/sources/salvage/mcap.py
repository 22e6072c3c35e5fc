"""Scans the records of an MCAP file without its summary and footer."""

from __future__ import annotations

import logging
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from wiclosure.pipeline.sources.salvage.found import FoundMessage, FoundTopic
from wiclosure.pipeline.sources.salvage.zstd import decompress_partly

if TYPE_CHECKING:
    from rosbags.interfaces import MessageDefinition

logger = logging.getLogger(__name__)

MAGIC = b"\x89MCAP0\r\n"
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 3, 4, 5, 6
_DAMAGE = (OSError, EOFError, ValueError, RuntimeError)  # what the decompressors raise


@dataclass
class _Known:
    """Schemas and channels met so far."""

    schemas: dict[int, tuple[str, MessageDefinition]] = field(default_factory=dict)
    topics: dict[int, FoundTopic] = field(default_factory=dict)


def scan_mcap(path: Path) -> Iterator[FoundMessage]:
    """All whole messages, from whole and cut chunks alike; of channels in ROS 1 or ROS 2 encoding."""
    known = _Known()
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            return
        for operation, content, whole in _records(file, path.stat().st_size):
            if operation == _CHUNK:
                inner = _chunk_content(content)
                for inner_operation, record, inner_whole in _records(BytesIO(inner), len(inner)):
                    if inner_whole:
                        yield from _message(inner_operation, record, known)
            elif whole:
                yield from _message(operation, content, known)


def is_ros2_profile(path: Path) -> bool:
    """Whether the file says that ROS 2 wrote it; rosbags refuses any other, though the messages may be ROS messages."""
    with path.open("rb") as file:
        head = file.read(64)
    return head[17:25] == b"\4\0\0\0ros2"


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, bytes, bool]]:
    """Operation, content and whether it is whole, of each record."""
    while len(head := file.read(9)) == 9 and head[0]:
        length = int.from_bytes(head[1:], "little")
        content = file.read(min(length, size - file.tell()))
        yield head[0], content, len(content) == length


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
                yield FoundMessage(known.topics[channel], log_time_ns, record[22:])
    except (struct.error, UnicodeDecodeError) as error:
        logger.info("skipped a damaged record: %s", error)


def _remember_schema(record: bytes, known: _Known) -> None:
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    (number,) = struct.unpack_from("<H", record)
    name, encoding, text = _strings(record, 2, 3)
    is_msg = encoding in {"ros1msg", "ros2msg"}
    definition = MessageDefinition(MessageDefinitionFormat.MSG if is_msg else MessageDefinitionFormat.NONE, text)
    known.schemas[number] = (name, definition)


def _remember_channel(record: bytes, known: _Known) -> None:
    from rosbags.typesys.msg import normalize_msgtype

    number, schema = struct.unpack_from("<HH", record)
    topic, encoding = _strings(record, 4, 2)
    if schema in known.schemas and encoding in {"cdr", "ros1"}:
        msgtype, definition = known.schemas[schema]
        known.topics[number] = FoundTopic(
            topic, normalize_msgtype(msgtype), definition, "ros1" if encoding == "ros1" else "cdr"
        )


def _strings(record: bytes, position: int, count: int) -> list[str]:
    """Consecutive strings, each preceded by its length."""
    strings = []
    for _ in range(count):
        (length,) = struct.unpack_from("<I", record, position)
        strings.append(record[position + 4 : position + 4 + length].decode())
        position += 4 + length
    return strings


def _chunk_content(chunk: bytes) -> bytes:
    """What a chunk holds, as far as it decompresses."""
    try:
        (compression,) = _strings(chunk, 28, 1)
        compressed = chunk[28 + 4 + len(compression) + 8 :]
        if compression == "zstd":
            return decompress_partly(compressed)
        if compression == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            return bytes(LZ4FrameDecompressor().decompress(compressed))
    except (struct.error, *_DAMAGE) as error:
        logger.info("skipped a damaged chunk: %s", error)
        return b""
    return compressed if compression == "" else b""
