"""Names in a sentence."""

from __future__ import annotations

import pytest

from wiclosure.display import listed


@pytest.mark.parametrize(
    ("names", "text"),
    [([], ""), (["alpha"], "alpha"), (["alpha", "beta"], "alpha and beta"), (list("abcd"), "a, b, c and d")],
)
def test_only_the_last_two_names_are_joined_by_and(names: list[str], text: str) -> None:
    assert listed(names) == text
