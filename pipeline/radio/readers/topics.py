"""Rows from the topics of a bag: any message, by the paths of its fields."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from wiclosure.errors import InputError
from wiclosure.formats.name_pattern import NamePattern
from wiclosure.pipeline.radio.presets import preset_of_message
from wiclosure.pipeline.radio.readers.message_fields import FieldPath, field_paths, rows_of
from wiclosure.pipeline.radio.readers.rows import ReceivedAt, Row
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.pipeline.sources.bags import Bag, BagTopic, open_bag
from wiclosure.pipeline.sources.messages.headers import TimeMessage, nanoseconds_of

_PLAIN = ("from_", "to", "range_variance", "valid", "azimuth", "elevation", "x", "y", "z")
_SINGLE = ("range_sigma", "bearing_sigma")
RECEIVED = "received"


def topic_rows(path: Path, source: RadioSource, *, salvage: bool = False) -> Iterator[Row]:
    """One row for each measurement of each message on the topic, or on each topic of its family.

    Raises:
        InputError: the bag cannot be read, has no such topic, or its messages have no such fields.
    """
    with open_bag(path, salvage=salvage) as bag:
        for topic, ids in _topics(bag, source):
            where = f"{bag.path}, topic {topic.name} ({topic.msgtype})"
            paths = _paths(source, where, partial(_first_fields, bag, topic))
            yield from _rows(bag, topic, source, paths, ids)


def with_message_preset(path: Path, source: RadioSource, *, salvage: bool = False) -> RadioSource:
    """The source, with what is known of its messages' type where it says nothing itself.

    Raises:
        InputError: the bag cannot be read, or has no such topic.
    """
    with open_bag(path, salvage=salvage) as bag:
        msgtype = _topics(bag, source)[0][0].msgtype
    preset = preset_of_message(msgtype)
    if preset is None or source.range_ or source.azimuth or source.x:
        return source
    known = RadioSource.model_validate({"topic": "/", **preset.settings})
    update = {name: getattr(known, name) for name in known.model_fields_set - source.model_fields_set}
    return source.model_copy(update=update)


def _topics(bag: Bag, source: RadioSource) -> list[tuple[BagTopic, dict[str, str]]]:
    pattern = NamePattern(source.topic or "")
    found = [(topic, ids) for topic in bag.topics.values() if (ids := pattern.match(topic.name)) is not None]
    if not found and not (source.topic or "/").startswith("/"):
        return _topics(bag, source.model_copy(update={"topic": f"/{source.topic}"}))
    if not found:
        shown = ", ".join(list(bag.topics)[:20]) or "nothing"
        raise InputError(f"{bag.path} has no topic {source.topic}; it holds {shown}")
    return found


def _first_fields(bag: Bag, topic: BagTopic) -> str:
    _, message = next(bag.messages(topic.name), (0, None))
    return ", ".join(field_paths(message)[:40]) or "none"


def _paths(source: RadioSource, where: str, fields: Callable[[], str]) -> Mapping[str, FieldPath]:
    names: dict[str, str] = {
        key.removesuffix("_"): getattr(source, key) for key in _PLAIN if getattr(source, key) is not None
    }
    names |= {key: value for key in _SINGLE if isinstance(value := getattr(source, key), str)}
    if len(source.range_) > 1:
        raise InputError(f"{where}: range: names {len(source.range_)} fields; write one entry for each of them")
    if source.range_:
        names["range"] = source.range_[0]
    for key, limit in zip(("range_low", "range_high"), source.range_limits or (), strict=False):
        if isinstance(limit, str):
            names[key] = limit
    if not names.keys() & {"range", "azimuth", "x"}:
        known = f"; its fields: {fields()}"
        raise InputError(f"{where}: name the field of the range as range: (or azimuth:, or x: and y:){known}")
    stamp = source.stamp or ("header.stamp",)
    if stamp != (RECEIVED,):
        names |= dict(zip(("stamp", "stamp_ns"), stamp, strict=False))
    return {key: FieldPath.parsed(name) for key, name in names.items()}


def _rows(
    bag: Bag, topic: BagTopic, source: RadioSource, paths: Mapping[str, FieldPath], ids: Mapping[str, str]
) -> Iterator[Row]:
    limits = {
        key: limit
        for key, limit in zip(("range_low", "range_high"), source.range_limits or (), strict=False)
        if isinstance(limit, float)
    }
    for number, (received_ns, message) in enumerate(bag.messages(topic.name)):
        place = f"{topic.name} message {number}"
        try:
            for values in rows_of(message, paths):
                yield Row(place, {**limits, **ids, **values, "stamp": _stamp(values, received_ns)})
        except InputError as error:
            if number == 0:  # no message of the topic can have the field
                hint = (
                    ""
                    if source.stamp or "'header" not in str(error)
                    else "; name that of the time, or add stamp: received"
                )
                raise InputError(f"{bag.path}, {place}: {error}{hint}") from error
            yield Row(place, {}, str(error))


def _stamp(values: Mapping[str, Any], received_ns: int) -> object:
    """The message's own time; that of reception where it has none, or left it at zero."""
    if "stamp" not in values:
        return ReceivedAt(received_ns)
    if "stamp_ns" in values:
        return values["stamp"], values["stamp_ns"]
    stamp = values["stamp"]
    if isinstance(stamp, TimeMessage):
        return ReceivedAt(nanoseconds_of(stamp) or received_ns)
    return stamp
