"""Scans from a topic of a ROS bag."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from itertools import chain, islice
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.bag import Bag
from wiclosure.pipeline.sources.bag_files import KINDS
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.poses.frames import OneFrame
from wiclosure.pipeline.sources.scan_messages import ScanDecoder, ScanMessage, ScanMessages
from wiclosure.pipeline.sources.scan_topics import choose_topic
from wiclosure.pipeline.sources.stamps import Stamped, mended
from wiclosure.types import Scan

logger = logging.getLogger(__name__)

_FIRST = 4  # scans whose stamps tell how often they come


class RosbagSource:
    """A topic of point clouds in a ROS 1 or ROS 2 bag.

    Args:
        path: bag file or folder.
        topic: name of the topic; None takes the only one of point clouds.
        salvage: use what can be read of a bag without index or with damage.

    Raises:
        InputError: not a bag, damaged, or no such topic of point clouds, or no message on it.
    """

    def __init__(self, path: Path, topic: str | None = None, *, salvage: bool = False) -> None:
        self.path = path
        self._salvage = salvage
        with open_bag(path, salvage=salvage) as bag:
            self.topic = choose_topic(path, bag.topics, topic)
            self._count = bag.topics[self.topic].count
            self._kind = KINDS[bag.kind]

    @property
    def description(self) -> str:
        """One line for the user."""
        salvaged = ", salvaged" if self._salvage else ""
        return f"{self._kind} {self.path}, topic {self.topic}, {self._count} scans{salvaged}"

    def __len__(self) -> int:
        """Number of messages on the topic."""
        return self._count

    def __iter__(self) -> Iterator[Scan]:
        """The scans in the order of the recording, their stamps mended (see `stamps`), all in one sensor's axes."""
        place = f"{self.path}, topic {self.topic}"
        with open_bag(self.path, salvage=self._salvage) as bag:
            messages = mended(self._messages(bag), place)
            first = list(islice(messages, _FIRST))
            decoder = ScanDecoder(bag.topics[self.topic], place, _period_s([stamp_ns for stamp_ns, _ in first]))
            frame = OneFrame(bag, place)
            for stamp_ns, message in chain(first, messages):
                try:
                    scan = decoder.decode(message, stamp_ns)
                except Exception as error:  # rosbags raises anything for bytes that are no such message
                    self._refuse(message.number, error)
                    continue
                if (turned := frame.turned(scan, message.frame_id)) is not None:
                    yield turned
            frame.report()

    def _messages(self, bag: Bag) -> Iterator[Stamped[ScanMessage]]:
        """The messages that can be read, with their headers' stamps."""
        parse = ScanMessages(bag.topics[self.topic])
        for number, (received_ns, raw) in enumerate(bag.read(self.topic)):
            try:
                message = parse(raw, number)
            except Exception as error:  # as above
                self._refuse(number, error)
            else:
                yield Stamped(message.stamp_ns, received_ns, message)

    def _refuse(self, number: int, error: Exception) -> None:
        """Raises for a message that cannot be decoded, or leaves it out when salvaging."""
        place = f"{self.path}, topic {self.topic}, message {number}: {error}"
        if not self._salvage:
            raise InputError(f"{place}; add --salvage to use the other messages") from error
        logger.warning("left out %s", place)


def _period_s(stamps_ns: list[int]) -> float | None:
    return float(np.median(np.diff(stamps_ns))) * 1e-9 if len(stamps_ns) > 1 else None
