"""What was used last stays, as far as it fits."""

from __future__ import annotations

from wiclosure.wiclosure_filter.covariance.recent import Recent


def test_what_is_used_now_stays_and_of_the_rest_what_was_used_last() -> None:
    recent: Recent[str] = Recent(10)
    for key in "abcd":
        recent.add(key, key.upper(), 4)
        recent.forget([key])
    assert "b" not in recent
    assert [recent[key] for key in "cd"] == ["C", "D"]
    recent.add("e", "E", 40)
    recent.forget(["e", "c"])  # more than fits, and needed now
    assert "d" not in recent
    assert recent["e"] == "E"
    assert recent["c"] == "C"
