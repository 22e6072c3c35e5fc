"""What is suggested in the place of a name that there is not."""

from __future__ import annotations

import pytest

from wiclosure.suggestions import did_you_mean, nearest

FILTERS = ("none", "wiclosure", "range-gate", "oracle", "random")


@pytest.mark.parametrize(
    ("typed", "meant"),
    [("oracl", "oracle"), ("Wiclosure", "wiclosure"), ("rangegate", "range-gate"), ("xyz", None), ("", None)],
)
def test_the_nearest_name(typed: str, meant: str | None) -> None:
    assert nearest(typed, FILTERS) == meant
    assert did_you_mean(typed, FILTERS) == (f"did you mean {meant}? " if meant else "")


def test_the_name_is_given_as_it_is_written() -> None:
    assert nearest("alpha", ["Alpha", "beta"]) == "Alpha"
    assert nearest("alpha", []) is None
