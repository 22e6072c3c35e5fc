"""Reads recordings that were not closed or lost their end: record by record, without an index.

A scanner yields every message that is whole, in the order of the file, and never raises for damage: it skips a chunk
that does not decompress and stops where the records end.
"""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from wiclosure.pipeline.sources.salvage.found import FoundMessage, FoundTopic
from wiclosure.pipeline.sources.salvage.mcap import scan_mcap
from wiclosure.pipeline.sources.salvage.ros1 import scan_ros1

if TYPE_CHECKING:
    from rosbags.interfaces import MessageDefinition

logger = logging.getLogger(__name__)


Scanner: TypeAlias = Callable[[Path], Iterator[FoundMessage]]


def scan_file(path: Path, kind: str) -> Iterator[FoundMessage]:
    """All whole messages of one file of the given kind (`ros1`, `mcap` or `sqlite3`)."""
    scanners: Mapping[str, Scanner] = {"ros1": scan_ros1, "mcap": scan_mcap, "sqlite3": scan_sqlite3}
    return scanners[kind](path)


def scan_sqlite3(path: Path) -> Iterator[FoundMessage]:
    """All whole messages of a ROS 2 sqlite3 file, those in its write-ahead log included."""
    for options in ("mode=ro", "immutable=1"):  # the first sees the write-ahead log, the second needs no lock
        read = 0
        try:
            with closing(sqlite3.connect(f"file:{path}?{options}", uri=True)) as database:
                for message in _rows(database):
                    read += 1
                    yield message
            return
        except sqlite3.Error as error:
            logger.info("%s: reading stopped after %d messages: %s", path, read, error)
        if read:
            return


def _rows(database: sqlite3.Connection) -> Iterator[FoundMessage]:
    from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

    database.execute("PRAGMA writable_schema = ON")  # lets SQLite read a file that is shorter than it says
    definitions: dict[str, MessageDefinition] = {}
    if database.execute("SELECT 1 FROM sqlite_master WHERE name = 'message_definitions'").fetchone():
        rows = database.execute("SELECT topic_type, encoding, encoded_message_definition FROM message_definitions")
        definitions = {
            msgtype: MessageDefinition(MessageDefinitionFormat.MSG, text)
            for msgtype, how, text in rows
            if how == "ros2msg"
        }
    nothing = MessageDefinition(MessageDefinitionFormat.NONE, "")
    topics = {
        number: FoundTopic(name, msgtype, definitions.get(msgtype, nothing), "cdr")
        for number, name, msgtype in database.execute("SELECT id, name, type FROM topics")
    }
    # By row, not by time: the index may be what is damaged, and rows were written in order of arrival.
    for topic, stamp_ns, data in database.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id"):
        if topic in topics:
            yield FoundMessage(topics[topic], stamp_ns, data)
