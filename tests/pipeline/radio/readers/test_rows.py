from __future__ import annotations

from dataclasses import FrozenInstanceError

import pytest

from wiclosure.pipeline.radio.readers.rows import FIELDS, ReceivedAt, Row
from wiclosure.pipeline.radio.source import keys


def test_rows_have_keys_of_the_source_and_the_limits():
    """`range_limits` of the source is two fields of a row."""
    assert len(set(FIELDS)) == len(FIELDS)
    assert set(FIELDS) - set(keys()) == {"range_low", "range_high"}


def test_a_row_is_readable_unless_it_names_a_problem():
    assert Row("line 7", {"stamp": "1.5"}).problem is None
    assert Row("line 7", {}, "4 cells, 5 expected") != Row("line 7", {})


def test_the_time_of_reception_is_no_number_of_the_log():
    received = ReceivedAt(5)
    assert received == ReceivedAt(5)
    assert received != 5
    with pytest.raises(FrozenInstanceError):
        received.stamp_ns = 6
