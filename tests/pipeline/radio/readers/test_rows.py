from __future__ import annotations

from dataclasses import FrozenInstanceError

import pytest

from wiclosure.pipeline.radio.readers.rows import ReceivedAt, Row


def test_a_row_is_readable_unless_it_names_a_problem():
    assert Row("line 7", {"stamp": "1.5"}).problem is None
    assert Row("line 7", {}, "4 cells, 5 expected") != Row("line 7", {})


def test_the_time_of_reception_is_no_number_of_the_log():
    received = ReceivedAt(5)
    assert received == ReceivedAt(5)
    assert received != 5
    with pytest.raises(FrozenInstanceError):
        received.stamp_ns = 6
