from __future__ import annotations

import logging

import pytest

from wiclosure.pipeline.radio.readers.account import ANCHOR, EMPTY, FAR, UNKNOWN, UNREADABLE, Account


def test_each_reason_is_counted_with_its_first_place() -> None:
    account = Account("uwb.csv", rows=9)
    account.leave_out(UNREADABLE, "line 3", "range is 'x'")
    account.leave_out(ANCHOR, "line 4")
    account.leave_out(UNREADABLE, "line 7", "another")
    assert account.sentences() == [
        "2 of 9 readings could not be read (first: line 3: range is 'x')",
        "1 of 9 readings are with anchors (first: line 4)",
    ]


def test_unknown_tags_are_listed_by_how_often_they_occur_with_the_key_to_add() -> None:
    account = Account("uwb.csv", rows=20)
    account.ids.update({"7": 2, "12": 5})
    for _ in range(7):
        account.leave_out(UNKNOWN, "line 1")
    assert account.sentences() == [
        "7 of 20 readings are with tags that name no robot: 12 (5), 7 (2); map them with robots: {12: NAME}, or list"
        " them as anchors"
    ]


def test_a_note_is_kept_once() -> None:
    account = Account("uwb.csv")
    account.note("stamps are read as s")
    account.note("stamps are read as s")
    assert account.notes == ["stamps are read as s"]


@pytest.mark.parametrize(("reason", "level"), [(ANCHOR, logging.INFO), (FAR, logging.WARNING)])
def test_only_what_may_be_a_mistake_is_a_warning(reason: str, level: int, caplog: pytest.LogCaptureFixture) -> None:
    account = Account("uwb.csv", rows=2, used=1)
    account.leave_out(reason, "line 2")
    with caplog.at_level(logging.INFO):
        account.report()
    (record,) = caplog.records
    assert record.levelno == level
    assert record.getMessage().startswith("uwb.csv: 1 readings used; 1 of 2 readings")


def test_that_nothing_is_left_is_a_warning(caplog: pytest.LogCaptureFixture) -> None:
    account = Account("uwb.csv", rows=1)
    account.leave_out(EMPTY, "line 2")
    account.report()
    assert caplog.messages == ["uwb.csv: 0 readings used; 1 of 1 readings hold no range and no bearing (first: line 2)"]


def test_what_is_whole_says_nothing(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.DEBUG):
        Account("uwb.csv", rows=2, used=2).report()
    assert not caplog.records
