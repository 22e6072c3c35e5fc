from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.display import significant


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.118, "0.12"), (0.12, "0.12"), (8.004, "8.0"), (0.0361, "0.036"), (87.3, "87"), (123.4, "123"), (0.0, "0.0"),
        (9.96, "10"), (0.0996, "0.10"), (-0.118, "-0.12"), (12345.6, "12,346"),
        (math.inf, "inf"), (1.14e-14, "1.1e-14"),
    ],
)  # fmt: skip
def test_two_digits_always(value: float, text: str) -> None:
    assert significant(value) == text


@given(st.floats(1e-6, 1e6), st.integers(1, 4))
def test_it_is_as_near_as_its_digits_allow(value: float, digits: int) -> None:
    said = float(significant(value, digits).replace(",", ""))
    assert abs(said - value) <= 0.5 * 10.0 ** (math.floor(math.log10(value)) - digits + 1) * (1 + 1e-9) + 1e-12 or (
        value >= 1 and abs(said - value) <= 0.5
    )
