"""What the scanners of damaged recordings find: topics and messages."""

from __future__ import annotations

import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from wiclosure.formats.unpacking import LARGEST_BLOCK

if TYPE_CHECKING:
    from rosbags.interfaces import MessageDefinition

logger = logging.getLogger(__name__)

ROS1_MAGIC = b"#ROSBAG V2.0\n"
MCAP_MAGIC = b"\x89MCAP0\r\n"

LARGEST_RECORD = 2 * LARGEST_BLOCK
"""Bytes of a record that are read into memory."""
_REMEMBERED = 3  # the first ones tell enough


class FoundTopic(NamedTuple):
    """What a recording says of a topic; `encoding` is `cdr` or `ros1` for ROS messages, else `json`, `protobuf` ..."""

    name: str
    msgtype: str
    definition: MessageDefinition
    encoding: str


class FoundMessage(NamedTuple):
    """One message, still serialised."""

    topic: FoundTopic
    stamp_ns: int
    data: bytes


TopicChoice: TypeAlias = Callable[[FoundTopic], bool]
"""Whether the data of a topic's messages are wanted."""


def everything(topic: FoundTopic) -> bool:
    """All data are."""
    return True


class Damage:
    """Takes down what a scanner had to leave out; none of it: the file is whole."""

    def __init__(self) -> None:
        self.found: list[str] = []

    def __call__(self, what: str) -> None:
        """Something is not as it should be."""
        logger.info("%s", what)
        if len(self.found) < _REMEMBERED:
            self.found.append(what)
