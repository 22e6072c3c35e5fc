"""What the scanners of damaged recordings find: topics and messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from wiclosure.pipeline.sources.messages.headers import Encoding

if TYPE_CHECKING:
    from rosbags.interfaces import MessageDefinition


class FoundTopic(NamedTuple):
    """What a recording says of a topic."""

    name: str
    msgtype: str
    definition: MessageDefinition
    encoding: Encoding


class FoundMessage(NamedTuple):
    """One message, still serialised."""

    topic: FoundTopic
    stamp_ns: int
    data: bytes
