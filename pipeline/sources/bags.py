"""Opens ROS bags of all kinds: through rosbags, and record by record where it refuses a bag that is whole."""

from __future__ import annotations

import heapq
import logging
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from wiclosure.errors import InputError
from wiclosure.formats.unpacking import LARGEST_BLOCK, unpack
from wiclosure.pipeline.sources.bag import Bag, BagTopic, RawMessage, counted_topics, decompressed, same_topic
from wiclosure.pipeline.sources.bag_files import (
    bag_kind,
    has_write_ahead_log,
    is_listed,
    plain_files,
    several_recordings,
)
from wiclosure.pipeline.sources.salvage.found import FoundTopic
from wiclosure.pipeline.sources.scanned_bag import damaged, scanned_bag, survey_bag

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    Reader: TypeAlias = Reader1 | Reader2

logger = logging.getLogger(__name__)

__all__ = ["Bag", "BagTopic", "RawMessage", "open_bag"]

_SPLIT_JITTER_NS = 10**9  # messages that were under way when a recorder began its next file


def topic_names(path: Path, *, salvage: bool = False) -> tuple[str, ...]:
    """Names of a bag's topics.

    Raises:
        InputError: see `open_bag`.
    """
    with open_bag(path, salvage=salvage) as bag:
        return tuple(bag.topics)


@contextmanager
def open_bag(path: Path, *, salvage: bool = False) -> Iterator[Bag]:
    """Opens a ROS 1 bag (file, or folder of split files), or a ROS 2 bag (folder with or without metadata, or file).

    What `metadata.yaml` says of a ROS 2 bag is used for the order of its files alone: the files tell the rest, and are
    right where the two differ.

    Args:
        path: file or folder.
        salvage: read record by record and use whatever is whole, for bags without index or with damage.

    Raises:
        InputError: not a bag, or damaged (says how many messages could be salvaged).
    """
    kind = bag_kind(path)
    if kind is None:
        raise InputError(f"{path} is not a ROS bag; expected a .bag, .mcap or .db3 file, or a ROS 2 bag folder")
    with ExitStack() as stack:
        files = plain_files(path, stack)
        if salvage:
            yield scanned_bag(path, kind, files, survey_bag(kind, files), salvaged=True)
            return
        if unclosed := [file for file in files if kind == "sqlite3" and has_write_ahead_log(file)]:
            raise damaged(path, kind, files, f"{unclosed[0].name} was not closed by its recorder")
        try:
            readers = _open_readers(kind, files, stack)
        except Exception as error:  # rosbags raises anything, from struct.error to AssertionError
            yield _whole_bag(path, kind, files, str(error))
            return
        if any(map(_may_be_unordered, readers)):
            yield _whole_bag(path, kind, files, "messages out of order", contents=False)
            return
        yield _indexed_bag(path, kind, files, readers)


def _whole_bag(path: Path, kind: str, files: Sequence[Path], refusal: str, *, contents: bool = True) -> Bag:
    """The bag read record by record, if nothing is wrong with any of them; `refusal` is why rosbags would not."""
    found = survey_bag(kind, files, contents=contents)
    if found.damage:
        raise damaged(path, kind, files, found.damage[0])
    if not found.count:
        raise damaged(path, kind, files, refusal)
    return scanned_bag(path, kind, files, found)


def _open_readers(kind: str, files: Sequence[Path], stack: ExitStack) -> list[Reader]:
    """An open reader of each file, in order of time."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    _bound_decompression()
    reader_of: type[Reader] = Reader1 if kind == "ros1" else Reader2
    readers: list[Reader] = []
    for file in files:
        readers.append(reader_of(file))
        stack.enter_context(readers[-1])
    return sorted(readers, key=lambda reader: reader.start_time)


@cache
def _bound_decompression() -> None:
    """Rosbags unpacks whatever stands in a chunk: its tables of decompressors get ours, which end."""
    from rosbags.rosbag1 import reader as ros1
    from rosbags.rosbag2 import storage_mcap as mcap

    ros1.decompressors.update({"bz2": partial(unpack, compression="bz2"), "lz4": partial(unpack, compression="lz4")})
    mcap.DECOMPRESSORS["zstd"] = lambda data, size: unpack(data, "zstd", min(size, LARGEST_BLOCK))
    mcap.DECOMPRESSORS["lz4"] = lambda data, size: unpack(data, "lz4", min(size, LARGEST_BLOCK))


def _may_be_unordered(reader: Reader) -> bool:
    """Whether an MCAP file has no chunks, by whose index rosbags puts messages in order."""
    from rosbags.rosbag2.storage_mcap import McapReader

    storage = getattr(reader, "storage", None)
    return isinstance(storage, McapReader) and not storage.chunks and reader.message_count > 0


def _indexed_bag(path: Path, kind: str, files: Sequence[Path], readers: Sequence[Reader]) -> Bag:
    topics = counted_topics(
        (_topic(kind, connection), max(connection.msgcount, 0))
        for reader in readers
        for connection in reader.connections
    )
    filled = [reader for reader in readers if reader.message_count]
    overlap = any(after.start_time < before.end_time - _SPLIT_JITTER_NS for before, after in pairwise(filled))
    if overlap and not is_listed(path, files):  # recordings of several robots run at the same time
        raise several_recordings(path, files)
    start_ns = min((reader.start_time for reader in filled), default=0)
    end_ns = max((reader.end_time - 1 for reader in filled), default=0)

    def read(topic: str) -> Iterator[RawMessage]:
        each = [_messages(kind, reader, topics[topic].found) for reader in filled]
        messages = heapq.merge(*each, key=lambda message: message[0]) if overlap else chain.from_iterable(each)
        done = 0
        while True:
            try:
                message = next(messages, None)
            except Exception as error:  # as above
                raise damaged(
                    path, kind, files, f"reading stopped after {done} messages of {topic}: {error}"
                ) from error
            if message is None:
                return
            done += 1
            yield message

    return Bag(path, kind, topics, start_ns, end_ns, read)


def _topic(kind: str, connection: Connection) -> FoundTopic:
    from rosbags.interfaces import ConnectionExtRosbag2

    stated = connection.ext.serialization_format if isinstance(connection.ext, ConnectionExtRosbag2) else "ros1"
    return FoundTopic(connection.topic, connection.msgtype, connection.msgdef, "ros1" if kind == "ros1" else stated)


def _messages(kind: str, reader: Reader, topic: FoundTopic) -> Iterator[RawMessage]:
    connections = [connection for connection in reader.connections if same_topic(_topic(kind, connection), topic)]
    if connections:
        for _, stamp_ns, raw in reader.messages(connections):
            yield stamp_ns, decompressed(raw)
