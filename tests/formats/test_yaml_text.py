from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.formats.yaml_text import load_yaml


@pytest.mark.parametrize("text", ["0010", "0x0A1B", "1_1", "12:30", "DE:CA:00:07", "0b11", "1e05", "12:30:45.5"])
def test_ids_stay_what_is_written(text: str) -> None:
    assert load_yaml(f"robots: {{{text}: alpha}}") == {"robots": {text: "alpha"}}


@given(st.integers() | st.floats(allow_nan=False).filter(lambda x: "e" not in repr(x)))
def test_decimal_numbers_are_numbers(number: float) -> None:
    text = "-.inf" if number == -math.inf else ".inf" if number == math.inf else repr(number)
    assert load_yaml(f"a: {text}") == {"a": number}


def test_other_values_are_as_ever() -> None:
    assert load_yaml("{a: true, b: null, c: text, d: [1.5e+3, -2.], e: ~}") == {
        "a": True, "b": None, "c": "text", "d": [1500.0, -2.0], "e": None
    }  # fmt: skip
