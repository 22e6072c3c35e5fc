"""The cells of one line of a table, and the numbers in them."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence

from wiclosure.errors import InputError
from wiclosure.formats.structured_text import parse_json

_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_LONGEST = 100  # characters of a cell that is too long for any measurement
SPACE = " "
"""The delimiter that stands for any white space."""
JSON = "{"
"""The delimiter that stands for a JSON object a line."""


def cells_of(line: str, delimiter: str) -> list[str]:
    """The cells of a line, without the blanks and the quotes around them; the delimiter `SPACE` is any white space."""
    line = line.rstrip("\r\n")
    if delimiter == SPACE:
        return line.split()
    try:
        cells = next(csv.reader([line], delimiter=delimiter), [])
    except csv.Error:  # a cell of more than 131,072 characters, which is nothing measured
        cells = [cell[:_LONGEST] for cell in line.split(delimiter)]
    return [_unquoted(cell.strip()) for cell in cells]


def _unquoted(cell: str) -> str:
    return cell[1:-1] if len(cell) > 1 and cell[0] == cell[-1] == "'" else cell


def json_cells(line: str) -> dict[str, str]:
    """The values of a JSON object by their paths, as `header.stamp`; empty where it is none."""
    try:
        content = parse_json(line)
    except InputError:
        return {}
    found: dict[str, str] = {}
    waiting = [("", content)]
    while waiting:
        path, value = waiting.pop()
        if isinstance(value, dict):
            waiting += [(f"{path}.{key}" if path else str(key), inner) for key, inner in reversed(value.items())]
        elif path:
            found[path] = "" if value is None else str(value)
    return found


def empty_at_end(cells: Sequence[str]) -> int:
    """How many cells at the end of a row are empty."""
    return next((n for n, cell in enumerate(reversed(cells)) if cell), len(cells))


def is_number(cell: str) -> bool:
    """Whether a cell reads as a number (Python's own `1_1` does not)."""
    return _NUMBER.fullmatch(cell) is not None


def number_of(cell: str) -> float:
    """The number in a cell; a comma may stand for the decimal point.

    Raises:
        ValueError: no number.
    """
    if not is_number(cell):
        raise ValueError(f"{cell[:40]!r} is no number")
    return float(cell.replace(",", "."))


def with_decimal_point(cell: str) -> str:
    """The cell, a decimal comma in it replaced."""
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell
