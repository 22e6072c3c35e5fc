from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.formats.plausible import LATEST_NS
from wiclosure.formats.stamps import nanoseconds, nanoseconds_of_column, seconds_text

STAMPS_NS = st.integers(-LATEST_NS, LATEST_NS)


@given(stamps_ns=st.lists(STAMPS_NS, min_size=1))
def test_every_nanosecond_survives_text(stamps_ns):
    texts = seconds_text(stamps_ns)
    assert [nanoseconds(text) for text in texts] == stamps_ns
    assert nanoseconds_of_column(np.array(texts, "S")).tolist() == stamps_ns


@given(whole=st.integers(0, 4 * 10**9), fraction=st.text("0123456789", max_size=9))
def test_a_column_is_read_as_each_of_its_rows(whole, fraction):
    texts = [f"{whole}.{fraction}", f"{whole}", "0.5"]
    assert nanoseconds_of_column(np.array(texts, "S")).tolist() == [nanoseconds(text) for text in texts]


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("1", 10**9),
        ("1.", 10**9),
        (".5", 5 * 10**8),
        ("-0.000000001", -1),
        ("1.5e3", 1500 * 10**9),
        ("1700000000.123456789", 1_700_000_000_123_456_789),
        ("0.00000000051", 1),
        ("0.00000000049", 0),
    ],
)
def test_decimal_seconds(text, ns):
    assert nanoseconds(text) == ns


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("now", "'now' is not a number"),
        ("", "'' is not a number"),
        ("1.2.3", "not a number"),
        ("nan", "'nan' is not finite"),
        ("-inf", "not finite"),
        ("9223372037", "too large for a time in seconds"),
    ],
)
def test_what_is_no_time_is_named(text, complaint):
    with pytest.raises(ValueError, match=complaint):
        nanoseconds(text)


@pytest.mark.parametrize("text", ["1.2.3", "now", "nan", "", "92233720370"])
def test_a_column_with_one_bad_row_is_refused(text):
    with pytest.raises(ValueError, match=r"number|finite|too large"):
        nanoseconds_of_column(np.array(["1.0", text], "S"))


def test_an_empty_column():
    assert nanoseconds_of_column(np.zeros(0, "S3")).tolist() == []
