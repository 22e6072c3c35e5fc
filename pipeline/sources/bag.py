"""An open ROS bag of whatever kind: which topics there are, and their messages, still serialised."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from wiclosure.errors import InputError
from wiclosure.formats.unpacking import ZSTD_MAGIC, unpack
from wiclosure.pipeline.sources.messages.ros_types import Encoding, deserialize, recorded_typestore
from wiclosure.pipeline.sources.salvage.found import FoundTopic

logger = logging.getLogger(__name__)

RawMessage: TypeAlias = tuple[int, bytes]
"""Time of reception in nanoseconds, and the serialised message."""

_ENCODINGS: Mapping[str, Encoding] = {"ros1": "ros1", "cdr": "cdr"}


@dataclass(frozen=True, slots=True)
class BagTopic:
    """A topic, and how many messages the bag holds on it."""

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

    @property
    def is_ros(self) -> bool:
        """Whether its messages are ROS messages; others (JSON, Protobuf) are listed, not read."""
        return self.found.encoding in _ENCODINGS

    @property
    def encoding(self) -> Encoding:
        """How its messages are serialised.

        Raises:
            InputError: they are no ROS messages.
        """
        if not self.is_ros:
            raise InputError(
                f"topic {self.name} holds {self.msgtype} as {self.found.encoding}, and only ROS messages can be read;"
                " convert it to a ROS bag, or name another topic"
            )
        return _ENCODINGS[self.found.encoding]


@dataclass(frozen=True, slots=True)
class Bag:
    """An open bag.

    Args:
        path: file or folder.
        kind: one of `wiclosure.pipeline.sources.bag_files.KINDS`.
        topics: by name.
        start_ns, end_ns: times of the first and last message; equal where there is none.
        read: serialised messages of one topic, in order.
        salvaged: whether it was read for whatever is whole of it.
    """

    path: Path
    kind: str
    topics: Mapping[str, BagTopic]
    start_ns: int
    end_ns: int
    read: Callable[[str], Iterator[RawMessage]]
    salvaged: bool = False

    def topics_of(self, msgtype: str) -> list[str]:
        """Topics that hold messages of a type of ROS."""
        return [t.name for t in self.topics.values() if t.is_ros and t.msgtype == msgtype and t.count]

    def require_topic_of(self, msgtype: str, requested: str) -> str:
        """Name of a topic that holds messages of this type.

        Raises:
            InputError: no such topic, or of another type; names those that have.
        """
        name = topic_name(self.topics, requested)
        if name not in (known := self.topics_of(msgtype)):
            others = ", ".join(known) or "none"
            raise InputError(f"{self.path} has no messages of {msgtype} on {requested}; topics that have: {others}")
        return name

    def messages(self, topic: str) -> Iterator[tuple[int, object]]:
        """Time of reception and deserialised message, of each message of a topic.

        Raises:
            InputError: the bag is damaged, or a message does not fit its type (left out of a salvaged bag).
        """
        encoding, found = self.topics[topic].encoding, self.topics[topic].found
        store = recorded_typestore(encoding, found.msgtype, found.definition)
        for number, (stamp_ns, raw) in enumerate(self.read(topic)):
            try:
                message = deserialize(store, encoding, raw, found.msgtype)
            except Exception as error:  # rosbags does not say which
                place = f"{self.path}, topic {topic}, message {number}: no {found.msgtype} ({error})"
                if not self.salvaged:
                    raise InputError(f"{place}; add --salvage to use the other messages") from error
                logger.warning("left out %s", place)
            else:
                yield stamp_ns, message


def topic_name(topics: Collection[str], requested: str) -> str:
    """As it stands in the bag: the slash that it begins with may be left out."""
    return requested if requested in topics else f"/{requested.strip('/')}"


def counted_topics(found: Iterable[tuple[FoundTopic, int]]) -> dict[str, BagTopic]:
    """Topics by name, from all descriptions of them; of two that differ, the one with more messages is read."""
    counts: dict[FoundTopic, int] = {}
    kinds: dict[tuple[str, str, str], FoundTopic] = {}
    for topic, count in found:  # one topic is described again in each file, sometimes without its definition
        first = kinds.setdefault((topic.name, topic.msgtype, topic.encoding), topic)
        counts[first] = counts.get(first, 0) + count
    topics: dict[str, BagTopic] = {}
    for topic in sorted(counts, key=lambda topic: (topic.name, counts[topic])):
        if topics.get(topic.name, BagTopic(topic, 0)).count:
            logger.warning("topic %s has messages of several types; those of %s are read", topic.name, topic.msgtype)
        topics[topic.name] = BagTopic(topic, counts[topic])
    return topics


def same_topic(one: FoundTopic, other: FoundTopic) -> bool:
    """Whether both describe one topic, its type and encoding; definitions may be missing from one of them."""
    return (one.name, one.msgtype, one.encoding) == (other.name, other.msgtype, other.encoding)


def decompressed(raw: bytes) -> bytes:
    """A message without its compression; a serialised message never starts with these bytes.

    Raises:
        UnpackError: it is damaged, or larger than any message.
    """
    return unpack(raw, "zstd") if raw[:4] == ZSTD_MAGIC else raw
