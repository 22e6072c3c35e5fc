"""Scans from a topic of a ROS bag."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Sequence
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
_TOGETHER_NS = 10**7  # no LiDAR makes a hundred sweeps a second


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
            messages = mended(_together(self._messages(bag), place), place)
            first = list(islice(messages, _FIRST))
            decoder = ScanDecoder(bag.topics[self.topic], place, _period_s([stamp_ns for stamp_ns, _ in first]))
            frame = OneFrame(bag, place, (message.frame_id for _, sweep in first for message in sweep))
            merged = 0
            for stamp_ns, sweep in chain(first, messages):
                scans = [self._scan(message, stamp_ns, decoder, frame) for message in sweep]
                if found := [scan for scan in scans if scan is not None]:
                    merged += len(found) > 1
                    yield found[0] if len(found) == 1 else _merged(found)
            frame.report()
            if merged:
                logger.warning("%s: clouds of the same stamp were merged, %d times, into one scan each", place, merged)

    def _scan(self, message: ScanMessage, stamp_ns: int, decoder: ScanDecoder, frame: OneFrame) -> Scan | None:
        """The scan of a message in the axes of all, or None where it cannot be had."""
        try:
            scan = decoder.decode(message, stamp_ns)
        except Exception as error:  # rosbags raises anything for bytes that are no such message
            self._refuse(message.number, error)
            return None
        return frame.turned(scan, message.frame_id)

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


def _together(messages: Iterable[Stamped[ScanMessage]], place: str) -> Iterator[Stamped[tuple[ScanMessage, ...]]]:
    """Messages of one stamp as one sweep: of sensors that are triggered together, or of one that sends parts.

    Those of one frame must also have been received together, for stamps may stand still; a message that was recorded
    twice is no part.
    """
    sweep: list[Stamped[ScanMessage]] = []
    copies = 0
    for message in messages:
        if any(_is_copy(message, part) for part in sweep):
            copies += 1
        elif sweep and _belongs(message, sweep):
            sweep.append(message)
        else:
            if sweep:
                yield _sweep(sweep)
            sweep = [message]
    if sweep:
        yield _sweep(sweep)
    if copies:
        logger.warning("%s: %d clouds were recorded twice; the copies were left out", place, copies)


def _sweep(parts: Sequence[Stamped[ScanMessage]]) -> Stamped[tuple[ScanMessage, ...]]:
    return Stamped(parts[0].header_ns, parts[0].received_ns, tuple(part.content for part in parts))


def _is_copy(message: Stamped[ScanMessage], other: Stamped[ScanMessage]) -> bool:
    return message.header_ns == other.header_ns != 0 and message.content.raw == other.content.raw


def _belongs(message: Stamped[ScanMessage], sweep: Sequence[Stamped[ScanMessage]]) -> bool:
    if message.header_ns != sweep[0].header_ns or message.header_ns == 0:
        return False
    if message.content.frame_id not in {part.content.frame_id for part in sweep}:
        return True
    return abs(message.received_ns - sweep[0].received_ns) < _TOGETHER_NS


def _merged(scans: Sequence[Scan]) -> Scan:
    """One scan of several with one stamp; times and intensities where all have them."""
    times = [scan.times for scan in scans if scan.times is not None]
    intensities = [scan.intensity for scan in scans if scan.intensity is not None]
    return Scan(
        scans[0].stamp_ns,
        np.concatenate([scan.points for scan in scans]),
        np.concatenate(times) if len(times) == len(scans) else None,
        np.concatenate(intensities) if len(intensities) == len(scans) else None,
    )


def _period_s(stamps_ns: list[int]) -> float | None:
    return float(np.median(np.diff(stamps_ns))) * 1e-9 if len(stamps_ns) > 1 else None
