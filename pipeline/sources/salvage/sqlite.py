"""Scans the rows of a ROS 2 sqlite3 file without its index."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import quote

from wiclosure.pipeline.sources.salvage.found import Damage, FoundMessage, FoundTopic, TopicChoice, everything

if TYPE_CHECKING:
    from rosbags.interfaces import MessageDefinition


def scan_sqlite3(path: Path, damage: Damage, wanted: TopicChoice = everything) -> Iterator[FoundMessage]:
    """All whole messages, those in its write-ahead log included.

    Args:
        path: the file.
        damage: takes down what is left out.
        wanted: of no meaning here: only data that are read are known to be whole.
    """
    _check_size(path, damage)
    for options in ("mode=ro", "immutable=1"):  # the first sees the write-ahead log, the second needs no lock
        read = 0
        try:
            with closing(sqlite3.connect(f"file:{quote(str(path))}?{options}", uri=True)) as database:
                for message in _rows(database, damage):
                    read += 1
                    yield message
            return
        except (sqlite3.Error, UnicodeDecodeError) as error:
            damage(f"reading stopped after {read} messages: {error}")
        if read:
            return


def _check_size(path: Path, damage: Damage) -> None:
    """Compares the file's size with that in its head."""
    with path.open("rb") as file:
        head = file.read(32)
    page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
    if path.stat().st_size < (65536 if page == 1 else page) * pages:
        damage("the file is shorter than it says")


def _rows(database: sqlite3.Connection, damage: Damage) -> Iterator[FoundMessage]:
    database.execute("PRAGMA writable_schema = ON")  # lets SQLite read a file that is shorter than it says
    topics = _topics(database)
    # By row, not by time: the index may be what is damaged, and rows were written in order of arrival.
    for topic, stamp_ns, data in database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id"):
        if topic in topics and isinstance(stamp_ns, int) and isinstance(data, bytes):
            yield FoundMessage(topics[topic], stamp_ns, data)
        else:
            damage(f"a message belongs to topic {topic}, which is described nowhere, or is no message")


def _topics(database: sqlite3.Connection) -> dict[int, FoundTopic]:
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    definitions: dict[str, MessageDefinition] = {}
    if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
        rows = database.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
        definitions = {
            msgtype: MessageDefinition(MessageDefinitionFormat.MSG, text)
            for msgtype, how, text in rows
            if how == "ros2msg"
        }
    nothing = MessageDefinition(MessageDefinitionFormat.NONE, "")
    return {
        number: FoundTopic(str(name), str(msgtype), definitions.get(msgtype, nothing), str(encoding or "cdr"))
        for number, name, msgtype, encoding in database.execute(
            "SELECT id, name, type, serialization_format FROM topics"
        )
    }
