from __future__ import annotations

from types import SimpleNamespace

import pytest

from wiclosure.errors import InputError
from wiclosure.pipeline.sources.messages.headers import nanoseconds_of, usual_fields
from wiclosure.pipeline.sources.messages.ros_types import typestore


@pytest.mark.parametrize("encoding", ["ros1", "cdr"])
@pytest.mark.parametrize(
    ("sec", "nanosec", "expected_ns"),
    [(0, 0, 0), (0, 999_999_999, 999_999_999), (1_700_000_000, 123_456_789, 1_700_000_000_123_456_789)],
)
def test_times_are_exact_to_the_nanosecond(encoding, sec, nanosec, expected_ns):
    """A float64 would lose the last digits of times since 1970."""
    time = typestore(encoding).types["builtin_interfaces/msg/Time"]
    assert nanoseconds_of(time(sec=sec, nanosec=nanosec)) == expected_ns


@pytest.mark.parametrize(
    "error", [AttributeError("no x"), TypeError("a str"), ValueError("no number"), OverflowError()]
)
def test_other_fields_than_the_usual_are_one_line(error: Exception) -> None:
    says = r"a\.bag, topic /odom: the bag's own definition of its messages is another"
    with pytest.raises(InputError, match=says), usual_fields("a.bag, topic /odom"):
        raise error


@pytest.mark.parametrize("seconds", ["x" * 9, [1, 2], None])
def test_stamps_that_are_no_numbers_are_no_stamps(seconds: object) -> None:
    with pytest.raises((TypeError, ValueError)):
        nanoseconds_of(SimpleNamespace(sec=seconds, nanosec=0))
