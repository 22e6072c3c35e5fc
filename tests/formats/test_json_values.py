from __future__ import annotations

from collections.abc import Callable
from decimal import Decimal
from typing import Any

import pytest

from wiclosure.errors import InputError
from wiclosure.formats.json_values import Record, name, number, optional, shown, vector


@pytest.mark.parametrize(
    ("read", "value", "expected"),
    [
        (number, Decimal("12.300"), 12.3),
        (number, 3, 3.0),
        (name, "alpha", "alpha"),
        (vector, [1, Decimal("0.5"), -2.0], (1.0, 0.5, -2.0)),
    ],
)
def test_good_values(read: Callable[[Record, str], Any], value: object, expected: object) -> None:
    assert read({"key": value}, "key") == expected
    assert optional({"key": value}, "key", read) == expected


@pytest.mark.parametrize(
    ("read", "value", "says"),
    [
        (number, True, '"key" is true; expected a number'),
        (number, "1", '"key" is "1"; expected a number'),
        (number, float("nan"), "expected a finite number"),
        (number, 10**400, "expected a finite number"),
        (name, "", "expected a name"),
        (name, 7, '"key" is 7; expected a name'),
        (vector, [1, 2], r"expected \[x, y, z\] in metres"),
        (vector, [1, 2, None], '"key" is null; expected a number'),
    ],
)
def test_bad_values_are_named(read: Callable[[Record, str], Any], value: object, says: str) -> None:
    with pytest.raises(InputError, match=says):
        read({"key": value}, "key")


def test_null_and_absent_values_are_none() -> None:
    assert optional({"key": None}, "key", number) is None
    assert optional({}, "key", number) is None


def test_long_values_are_cut() -> None:
    assert shown("x" * 100) == '"' + "x" * 56 + "..."
    assert shown(Decimal("1.50")) == "1.50"
