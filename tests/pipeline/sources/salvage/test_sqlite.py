from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from wiclosure.pipeline.sources.salvage.found import Damage
from wiclosure.pipeline.sources.salvage.sqlite import scan_sqlite3


@pytest.fixture
def database(recordings: dict[str, Path], tmp_path: Path) -> Path:
    path = tmp_path / "a.db3"
    path.write_bytes(recordings["sqlite3"].read_bytes())
    return path


def change(path: Path, statement: str) -> None:
    with closing(sqlite3.connect(path)) as connection:
        connection.execute(statement)
        connection.commit()


def test_rows_that_are_no_messages_are_left_out_and_taken_down(database: Path) -> None:
    change(database, "UPDATE messages SET topic_id = 99 WHERE id = 3")
    change(database, "UPDATE messages SET timestamp = 'noon' WHERE id = 5")
    damage = Damage()
    assert len(list(scan_sqlite3(database, damage))) == 10
    assert damage.found == ["a message belongs to topic 99, which is described nowhere, or is no message"] + [
        text for text in damage.found[1:] if "is no message" in text
    ]
    assert len(damage.found) == 2


def test_messages_come_in_the_order_in_which_they_were_written(database: Path) -> None:
    change(database, "UPDATE messages SET timestamp = 1 WHERE id = 7")
    stamps_ns = [message.stamp_ns for message in scan_sqlite3(database, Damage())]
    assert stamps_ns[6] == 1


def test_what_a_recorder_left_in_the_write_ahead_log_is_read(database: Path) -> None:
    with closing(sqlite3.connect(database)) as recorder:
        recorder.execute("PRAGMA journal_mode = WAL")
        recorder.execute("INSERT INTO messages SELECT 100, topic_id, timestamp + 1, data FROM messages WHERE id = 1")
        recorder.commit()
        assert database.with_name("a.db3-wal").stat().st_size > 0
        assert len(list(scan_sqlite3(database, Damage()))) == 13


def test_a_path_with_odd_characters(database: Path) -> None:
    odd = database.with_name("a?b#c %20.db3")
    database.rename(odd)
    assert len(list(scan_sqlite3(odd, Damage()))) == 12


def test_a_database_without_the_tables_of_a_bag_holds_nothing(tmp_path: Path) -> None:
    change(tmp_path / "other.db3", "CREATE TABLE t (x)")
    damage = Damage()
    assert list(scan_sqlite3(tmp_path / "other.db3", damage)) == []
    assert "reading stopped after 0 messages: no such table" in damage.found[0]
