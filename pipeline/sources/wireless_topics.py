"""Wireless measurements from the topics of a bag.

Read are `wiclosure_msgs/WirelessMeasurement` and `wiclosure_msgs/Heading` on whatever topic they are, and
`sensor_msgs/Range` where it is known who measured whom: either the caller says so by topic, or the message's `frame_id`
reads `alpha<-beta` (alpha heard beta).  Other Range topics (sonars, altimeters) are left alone.
"""

from __future__ import annotations

import logging
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol, TypeAlias, TypeVar, cast

from wiclosure.errors import InputError
from wiclosure.formats.radio.wireless_log import DEFAULT_RANGE_SIGMA_M
from wiclosure.pipeline.sources.bags import Bag, BagTopic, open_bag
from wiclosure.pipeline.sources.messages.headers import HeaderMessage, nanoseconds_of, usual_fields
from wiclosure.pipeline.sources.messages.ros_types import HEADING_TYPE, MEASUREMENT_TYPE
from wiclosure.pipeline.sources.messages.wireless_messages import decode_heading, decode_measurement
from wiclosure.types import Heading, WirelessLog, WirelessMeasurement

logger = logging.getLogger(__name__)

RANGE_TYPE = "sensor_msgs/msg/Range"
_HEARD = re.compile(r"\s*(.+?)\s*<-\s*(.+?)\s*")

_Record = TypeVar("_Record", WirelessMeasurement, Heading)

Link: TypeAlias = tuple[str, str]
"""Receiver and transmitter."""


class RangeMessage(Protocol):
    """`sensor_msgs/Range`, as rosbags makes it."""

    @property
    def header(self) -> HeaderMessage: ...  # noqa: D102  -- named by ROS

    min_range: float
    max_range: float
    range: float


class RangeWithVariance(Protocol):
    """`sensor_msgs/Range` since ROS 2 Iron."""

    variance: float


def read_wireless_topics(
    path: Path | str,
    *,
    range_topics: Mapping[str, Link] | None = None,
    ignored: Collection[str] = (),
    salvage: bool = False,
) -> WirelessLog:
    """All wireless measurements and headings in a bag, in order of time.

    Args:
        path: bag file or folder.
        range_topics: receiver and transmitter of each `sensor_msgs/Range` topic to read.
        ignored: topics that are left out.
        salvage: use what can be read of a damaged bag.

    Raises:
        InputError: the bag cannot be read, a message holds an impossible value, a topic in `range_topics` or `ignored`
            is missing, or one in `range_topics` is of another type.
    """
    links = dict(range_topics or {})
    with open_bag(Path(path), salvage=salvage) as bag:
        _check_topics(bag, links, ignored)
        read = [topic for topic in bag.topics.values() if topic.name not in ignored]
        measurements = [*_decoded(bag, read, MEASUREMENT_TYPE, decode_measurement)]
        headings = [*_decoded(bag, read, HEADING_TYPE, decode_heading)]
        for topic in read:
            if topic.msgtype == RANGE_TYPE:
                measurements += _ranges(bag, topic.name, links.get(topic.name))
    return WirelessLog() + WirelessLog(tuple(measurements), tuple(headings))


def _decoded(
    bag: Bag, topics: Sequence[BagTopic], msgtype: str, decode: Callable[[object], _Record]
) -> Iterator[_Record]:
    for topic in topics:
        if topic.msgtype == msgtype:
            for number, (_, message) in enumerate(bag.messages(topic.name)):
                try:
                    with usual_fields(msgtype):
                        record = decode(message)
                except InputError as error:
                    raise InputError(f"{bag.path}, topic {topic.name}, message {number}: {error}") from error
                yield record


def _ranges(bag: Bag, topic: str, link: Link | None) -> Iterator[WirelessMeasurement]:
    """Measurements of one Range topic; readings outside the sensor's own limits are no readings."""
    skipped = 0
    has_variance = "variance" in bag.topics[topic].found.definition.data
    for _, message in bag.messages(topic):
        with usual_fields(f"{bag.path}, topic {topic}"):
            reading = cast("RangeMessage", message)
            if (named := link or named_link(reading.header.frame_id)) is None:
                return  # a sonar's, or of robots that nobody has named: see `wiclosure.pipeline.radio.unused`
            if not _valid(reading):
                skipped += 1
                continue
            sigma_m = _sigma_m(message, has_variance=has_variance)
            measurement = WirelessMeasurement(nanoseconds_of(reading.header.stamp), *named, reading.range, sigma_m)
        yield measurement
    if skipped:
        logger.warning("%s, topic %s: %d ranges outside the sensor's limits were left out", bag.path, topic, skipped)


def named_link(frame_id: str) -> Link | None:
    """Receiver and transmitter that a frame `alpha<-beta` names, or None."""
    named = _HEARD.fullmatch(frame_id)
    return None if named is None else (named[1], named[2])


def _valid(reading: RangeMessage) -> bool:
    limit = reading.max_range if reading.max_range > 0 else math.inf
    return math.isfinite(reading.range) and max(reading.min_range, 0.0) <= reading.range <= limit


def _sigma_m(message: object, *, has_variance: bool) -> float:
    """By the message's variance where it states one, else what UWB usually has."""
    variance = cast("RangeWithVariance", message).variance if has_variance else 0.0
    return math.sqrt(variance) if variance > 0 else DEFAULT_RANGE_SIGMA_M


def _check_topics(bag: Bag, links: Mapping[str, Link], ignored: Collection[str]) -> None:
    for name in (*links, *ignored):
        if name not in bag.topics:
            raise InputError(f"{bag.path} has no topic {name}; it holds {', '.join(bag.topics) or 'nothing'}")
        if name in ignored:
            continue
        if bag.topics[name].msgtype != RANGE_TYPE:
            raise InputError(f"topic {name} of {bag.path} is {bag.topics[name].msgtype}; expected {RANGE_TYPE}")
