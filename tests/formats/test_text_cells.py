"""Cells of a line, and the numbers in them."""

from __future__ import annotations

import pytest

from wiclosure.formats.text_cells import SPACE, cells_of, is_number, json_cells, number_of, with_decimal_point


def test_numbers() -> None:
    assert number_of("1,5") == 1.5
    assert with_decimal_point("1,5") == "1.5"
    assert not is_number("1_1")
    with pytest.raises(ValueError, match="no number"):
        number_of("1_1")


@pytest.mark.parametrize(
    ("line", "delimiter", "cells"),
    [
        ("1; 2,5 ;\n", ";", ["1", "2,5", ""]),
        ("a,\"b, c\",'d'\r\n", ",", ["a", "b, c", "d"]),
        ("  1 \t 2\n", SPACE, ["1", "2"]),
    ],
)
def test_cells_of_a_line(line: str, delimiter: str, cells: list[str]) -> None:
    assert cells_of(line, delimiter) == cells


def test_cells_of_an_object() -> None:
    assert json_cells('{"header": {"stamp": 1.5}, "to": null}') == {"header.stamp": "1.5", "to": ""}
    assert json_cells('["header"]') == {}
