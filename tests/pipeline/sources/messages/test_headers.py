from __future__ import annotations

import pytest

from wiclosure.pipeline.sources.messages.headers import nanoseconds_of
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
