"""Radio in a bag that nothing reads: what it is, and what to write to use it."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from wiclosure.formats.name_pattern import NamePattern
from wiclosure.pipeline.radio.presets import preset_of_message
from wiclosure.pipeline.sources.bags import Bag, BagTopic, open_bag
from wiclosure.pipeline.sources.wireless_topics import RANGE_TYPE, named_link

_RADIO_NAME = re.compile(r"uwb|ultra_?wide|rang(e|ing)|linktrack|dwm1001|decawave|pozyx|aoa|bearing", re.IGNORECASE)
_NO_RADIO = re.compile(
    r"^(sensor_msgs/msg/(?!Range)|nav_msgs|tf2?_msgs|std_msgs/msg/(?!U?Int|Float)|visualization_msgs|geometry_msgs)"
)


@dataclass(frozen=True, slots=True)
class UnusedRadio:
    """Topics of one message type, alone or a family, that could hold radio.

    Args:
        topic: its name, or the pattern of the family's.
        topics: their names.
        msgtype: in ROS 2 notation.
        count: messages on all of them.
        frame_id: of the first message, where it has one.
        ids: what the names hold at the pattern's places.
        preset: that knows the messages, or None.
    """

    topic: str
    topics: tuple[str, ...]
    msgtype: str
    count: int
    frame_id: str
    ids: tuple[str, ...]
    preset: str | None

    def sentence(self, others: Sequence[str]) -> str:
        """What is there and what to add, for people.

        Args:
            others: robots that the bag's own could have measured; empty where the bag is nobody's.
        """
        kind = self.msgtype.replace("/msg/", "/")
        said = f"{self.count} {kind} messages on {self.topic} are not used"
        if len(self.topics) > 1:
            said += f" ({len(self.topics)} topics, ids {', '.join(self.ids)})"
            return f"{said}; add to wireless: {{topic: '{self.topic}', robots: {{ID: NAME}}}}"
        if self.msgtype == RANGE_TYPE:
            named = (
                f"frame_id {self.frame_id!r} names no pair of robots; " if self.frame_id else "no robots are named; "
            )
            other = others[0] if others else "NAME"
            return f"{said}: {named}if it is a radio's, add ranges: {{{self.topic}: {other}}} to the robot"
        if self.preset is not None:
            return f"{said}: add to wireless: {{topic: {self.topic}, robots: {{ID: NAME}}}} (preset {self.preset})"
        if self.msgtype.startswith("std_msgs/"):
            fields = f"{{topic: {self.topic}, range: data, stamp: received, receiver: NAME, transmitter: NAME}}"
            return f"{said}: if it is a radio's, add to wireless: {fields}"
        fields = f"{{topic: {self.topic}, range: FIELD, from: FIELD, to: FIELD}}"
        return f"{said}: if it is a radio's, add to wireless: {fields}"


def unused_radio(path: Path, used: Collection[str], *, salvage: bool = False) -> list[UnusedRadio]:
    """Topics of a bag that could hold radio, and that no source and no robot names.

    Args:
        path: the bag.
        used: topics, or patterns of topics, that are read.
        salvage: use what can be read of a damaged bag.
    """
    patterns = [NamePattern(name) for name in used]
    with open_bag(path, salvage=salvage) as bag:
        free = [
            topic
            for topic in bag.topics.values()
            if topic.count
            and topic.is_ros
            and _is_radio(topic)
            and not any(pattern.fits(topic.name) for pattern in patterns)
        ]
        found = [_described(bag, family, group) for family, group in _families(free)]
    return [radio for radio in found if radio.msgtype != RANGE_TYPE or named_link(radio.frame_id) is None]


def _is_radio(topic: BagTopic) -> bool:
    if topic.msgtype.startswith(("wiclosure_msgs/", "geometry_msgs/")):
        return False
    if preset_of_message(topic.msgtype) is not None:
        return True
    return not _NO_RADIO.match(topic.msgtype) and _RADIO_NAME.search(f"{topic.name} {topic.msgtype}") is not None


def _families(topics: Iterable[BagTopic]) -> list[tuple[str, list[BagTopic]]]:
    """Topics whose names differ in two numbers, under one pattern; the others alone."""
    groups: dict[tuple[str, str], list[BagTopic]] = {}
    for topic in topics:
        groups.setdefault((re.sub(r"\d+", "#", topic.name), topic.msgtype), []).append(topic)
    found: list[tuple[str, list[BagTopic]]] = []
    for (shape, _), group in groups.items():
        if len(group) > 1 and shape.count("#") == 2:
            found.append((shape.replace("#", "{from}", 1).replace("#", "{to}", 1), group))
        else:
            found += [(topic.name, [topic]) for topic in group]
    return found


def _described(bag: Bag, family: str, topics: Sequence[BagTopic]) -> UnusedRadio:
    first = topics[0]
    _, message = next(bag.messages(first.name), (0, None))
    header = getattr(message, "header", None)
    preset = preset_of_message(first.msgtype)
    pattern = NamePattern(family)
    ids = {tag for topic in topics for tag in (pattern.match(topic.name) or {}).values()}
    return UnusedRadio(
        topic=family,
        topics=tuple(topic.name for topic in topics),
        msgtype=first.msgtype,
        count=sum(topic.count for topic in topics),
        frame_id=str(getattr(header, "frame_id", "")),
        ids=tuple(sorted(ids, key=lambda tag: (len(tag), tag))),
        preset=None if preset is None else preset.name,
    )
