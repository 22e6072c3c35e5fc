from __future__ import annotations

import logging
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wiclosure.pipeline.radio.readers.digit_groups import marks_between_groups
from wiclosure.pipeline.radio.source import RadioSource

PATH = Path("uwb.csv")


def mark(cells: list[str], unit: str = "m", *, ranges: bool = True) -> str | None:
    source = RadioSource.model_validate({"path": PATH, "unit": unit})
    return marks_between_groups([[cell] for cell in cells], {0}, {0} if ranges else (), source, PATH).get(0)


@pytest.mark.parametrize("character", list("'\u2019_ \u00a0\u2009\u202f"))
def test_a_mark_that_is_no_decimal_one_stands_between_groups(character: str) -> None:
    assert mark([f"20{character}534", "950"], ranges=False) == character


@pytest.mark.parametrize(
    ("cells", "unit", "expected"),
    [
        (["20,534", "19,222"], "mm", ","),  # as decimals below a metre
        (["20,534mm", "19,222mm"], "mm", ","),
        (["20,534", "19,22"], "mm", None),
        (["20,534", "0,950"], "mm", None),
        (["20,534", "20534"], "mm", None),
        (["20,534", "19,222"], "m", None),  # as groups beyond what is believed
        (["2,534", "950", "870"], "cm", ","),
        (["2,534", "0", "0"], "cm", None),  # a code for nothing heard
        (["1,700,000,000"], "m", ","),
        (["1.234,5", "1.111,25"], "cm", "."),
        (["1.700.000", "12.5"], "m", None),  # it contradicts itself
        (["20.534", "19.222"], "mm", None),
        (["", "no", "12"], "mm", None),
    ],
)
def test_commas_and_points(cells: list[str], unit: str, expected: str | None) -> None:
    assert mark(cells, unit) == expected


def test_a_comma_in_other_columns_than_ranges_needs_to_be_sure() -> None:
    assert mark(["20,534", "950", "870"], "mm", ranges=False) is None


def test_ranges_that_may_be_either_are_said(caplog: pytest.LogCaptureFixture) -> None:
    assert mark(["2,534", "1,222"], "cm") is None
    assert "2,534 is read as 2.534 cm" in caplog.text


def test_decimal_metres_are_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        assert mark(["20,534", "19,222"]) is None
    assert not caplog.text


@given(st.lists(st.integers(1000, 999_999), min_size=1, max_size=20))
def test_millimetres_with_commas_are_told_from_decimals(values: list[int]) -> None:
    assert mark([f"{value:,}" for value in values], "mm") == ","
    assert mark([str(value) for value in values], "mm") is None
