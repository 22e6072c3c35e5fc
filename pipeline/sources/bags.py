"""ROS bags of all kinds behind one face: which topics there are, and their messages, still serialised."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.bag_files import (
    KINDS,
    METADATA,
    bag_kind,
    has_write_ahead_log,
    is_foreign,
    plain_files,
    several_recordings,
)
from wiclosure.pipeline.sources.messages.headers import Encoding
from wiclosure.pipeline.sources.messages.ros_types import deserialize, recorded_typestore
from wiclosure.pipeline.sources.salvage import zstd
from wiclosure.pipeline.sources.salvage.found import FoundTopic
from wiclosure.pipeline.sources.salvage.recover import scan_file

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    Reader: TypeAlias = Reader1 | Reader2

logger = logging.getLogger(__name__)

RawMessage: TypeAlias = tuple[int, bytes]
"""Time of reception in nanoseconds, and the serialised message."""

_SPLIT_JITTER_NS = 10**9  # messages that were under way when a recorder began its next file


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic, and how many messages the bag announces on it."""

    found: FoundTopic
    count: int

    @property
    def name(self) -> str:
        """Name, with its leading slash."""
        return self.found.name

    @property
    def msgtype(self) -> str:
        """Message type in ROS 2 notation (`sensor_msgs/msg/Imu`), for ROS 1 too."""
        return self.found.msgtype


@dataclass(frozen=True, slots=True)
class Bag:
    """An open bag.

    Args:
        path: file or folder.
        kind: one of `KINDS`.
        topics: by name.
        start_ns, end_ns: times of the first and last message; equal where there is none.
        read: serialised messages of one topic, in order.
        salvaged: whether it was read record by record, for whatever is whole.
    """

    path: Path
    kind: str
    topics: Mapping[str, BagTopic]
    start_ns: int
    end_ns: int
    read: Callable[[str], Iterator[RawMessage]]
    salvaged: bool = False

    def messages(self, topic: str) -> Iterator[tuple[int, object]]:
        """Time of reception and deserialised message, of each message of a topic.

        Raises:
            InputError: the bag is damaged, or a message does not fit its type (left out of a salvaged bag).
        """
        found = self.topics[topic].found
        store = recorded_typestore(found.encoding, found.msgtype, found.definition)
        for number, (stamp_ns, raw) in enumerate(self.read(topic)):
            try:
                message = deserialize(store, found.encoding, raw, found.msgtype)
            except Exception as error:  # rosbags does not say which
                place = f"{self.path}, topic {topic}, message {number}: no {found.msgtype} ({error})"
                if not self.salvaged:
                    raise InputError(f"{place}; add --salvage to use the other messages") from error
                logger.warning("left out %s", place)
            else:
                yield stamp_ns, message


@contextmanager
def open_bag(path: Path, *, salvage: bool = False) -> Iterator[Bag]:
    """Opens a ROS 1 bag (file, or folder of split files), or a ROS 2 bag (folder with or without metadata, or file).

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
        if salvage or is_foreign(kind, files):
            yield _salvaged_bag(path, kind, files)
            return
        if unclosed := [file for file in files if kind == "sqlite3" and has_write_ahead_log(file)]:
            raise _damaged(path, kind, files, f"{unclosed[0].name} was not closed by its recorder")
        yield _indexed_bag(path, kind, files, stack)


# ---------------------------------------------------------------------------------------------------- through rosbags
def _indexed_bag(path: Path, kind: str, files: Sequence[Path], stack: ExitStack) -> Bag:
    try:
        readers = _open_readers(path, kind, files, stack)
    except Exception as error:  # damage raises anything from struct.error to AssertionError in rosbags
        raise _damaged(path, kind, files, str(error)) from error
    counts: Counter[str] = Counter()
    found: dict[str, FoundTopic] = {}
    for connection in (connection for reader in readers for connection in reader.connections):
        counts[connection.topic] += max(connection.msgcount, 0)
        encoding: Encoding = "ros1" if kind == "ros1" else "cdr"
        topic = FoundTopic(connection.topic, connection.msgtype, connection.msgdef, encoding)
        found.setdefault(connection.topic, topic)
    topics = {name: BagTopic(found[name], counts[name]) for name in sorted(found)}
    filled = [reader for reader in readers if reader.message_count]
    _refuse_overlap(path, files, filled)
    start_ns = min((reader.start_time for reader in filled), default=0)
    end_ns = max((reader.end_time - 1 for reader in filled), default=0)

    def read(topic: str) -> Iterator[RawMessage]:
        messages = chain.from_iterable(_messages(reader, topic) for reader in filled)
        done = 0
        while True:
            try:
                message = next(messages, None)
            except Exception as error:  # as above
                raise _damaged(
                    path, kind, files, f"reading stopped after {done} messages of {topic}: {error}"
                ) from error
            if message is None:
                return
            done += 1
            yield message

    return Bag(path, kind, topics, start_ns, end_ns, read)


def _open_readers(path: Path, kind: str, files: Sequence[Path], stack: ExitStack) -> list[Reader]:
    """Open readers in order of time: one for a ROS 2 folder with metadata, else one a file."""
    from rosbags.rosbag1 import Reader as Reader1
    from rosbags.rosbag2 import Reader as Reader2

    unpacked_elsewhere = any(file.parent != path for file in files)
    if path.is_dir() and (path / METADATA).is_file() and not unpacked_elsewhere:
        return [stack.enter_context(Reader2(path))]
    reader_of: type[Reader] = Reader1 if kind == "ros1" else Reader2
    readers: list[Reader] = []
    for file in files:
        readers.append(reader_of(file))
        stack.enter_context(readers[-1])
    return sorted(readers, key=lambda reader: reader.start_time)


def _refuse_overlap(path: Path, files: Sequence[Path], readers: Sequence[Reader]) -> None:
    """Files of one split recording follow each other; recordings of several robots run at the same time."""
    if any(after.start_time < before.end_time - _SPLIT_JITTER_NS for before, after in pairwise(readers)):
        raise several_recordings(path, files)


def _messages(reader: Reader, topic: str) -> Iterator[RawMessage]:
    connections = [connection for connection in reader.connections if connection.topic == topic]
    if connections:
        for _, stamp_ns, raw in reader.messages(connections):
            yield stamp_ns, _unpacked(raw)


def _unpacked(raw: bytes) -> bytes:
    """Without its compression; a serialised message never starts with these bytes."""
    return zstd.decompress(raw) if raw[:4] == zstd.MAGIC else raw


# --------------------------------------------------------------------------------------------------- record by record
@dataclass(frozen=True, slots=True)
class _Survey:
    """What a scan of all records found."""

    topics: Mapping[str, BagTopic]
    start_ns: int
    end_ns: int

    @property
    def count(self) -> int:
        return sum(topic.count for topic in self.topics.values())


def _survey(kind: str, files: Sequence[Path]) -> _Survey:
    states = [file.stat() for file in files]
    return _survey_of(kind, tuple((f, s.st_size, s.st_mtime_ns) for f, s in zip(files, states, strict=True)))


@lru_cache(maxsize=32)
def _survey_of(kind: str, files: tuple[tuple[Path, int, int], ...]) -> _Survey:
    """Reads everything once; kept for as long as the files do not change, because it takes long."""
    counts: Counter[str] = Counter()
    found: dict[str, FoundTopic] = {}
    start_ns, end_ns = 2**63 - 1, 0
    for topic, stamp_ns, _ in chain.from_iterable(scan_file(file, kind) for file, _, _ in files):
        counts[topic.name] += 1
        found.setdefault(topic.name, topic)
        start_ns, end_ns = min(start_ns, stamp_ns), max(end_ns, stamp_ns)
    return _Survey({name: BagTopic(found[name], counts[name]) for name in sorted(found)}, start_ns, end_ns)


def _salvaged_bag(path: Path, kind: str, files: Sequence[Path]) -> Bag:
    survey = _survey(kind, files)
    if not survey.count:
        raise InputError(f"{path} holds no whole message, nothing can be salvaged; record it again")

    def read(topic: str) -> Iterator[RawMessage]:
        for message in chain.from_iterable(scan_file(file, kind) for file in files):
            if message.topic.name == topic:
                try:
                    raw = _unpacked(message.data)
                except zstd.ZstdError as error:
                    logger.warning("left out a message of %s, topic %s: %s", path, topic, error)
                else:
                    yield message.stamp_ns, raw

    return Bag(path, kind, survey.topics, survey.start_ns, survey.end_ns, read, salvaged=True)


def _damaged(path: Path, kind: str, files: Sequence[Path], reason: str) -> InputError:
    """The error for a bag without index or with damage: says what could be saved."""
    survey = _survey(kind, files)
    reason = " ".join(reason.split()).rstrip(".")
    if not survey.count:
        return InputError(f"{path} cannot be read as a {KINDS[kind]} ({reason}), and holds no whole message")
    largest = sorted(survey.topics.values(), key=lambda topic: -topic.count)[:5]
    shares = ", ".join(f"{topic.count} on {topic.name}" for topic in largest)
    return InputError(
        f"{path} is truncated, damaged or has no index ({reason}): {survey.count} messages can be read ({shares});"
        " add --salvage to use them"
    )
