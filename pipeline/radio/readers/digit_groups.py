"""Numbers whose digits stand in groups of three: `20,534`, `1'700'000'000`, `1.234,5`."""

from __future__ import annotations

import logging
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from pathlib import Path

from wiclosure.formats.radio.radio_units import metres
from wiclosure.pipeline.radio.source import RadioSource

logger = logging.getLogger(__name__)

_GROUPED = re.compile(
    r"[+-]?[1-9]\d{0,2}(?P<mark>[.,'\u2019_ \u00a0\u2009\u202f])\d{3}(?P<more>(?:(?P=mark)\d{3})*)"
    r"(?P<fraction>(?!(?P=mark))[.,]\d+)?\s*[a-z]*"
)
_WHOLE = re.compile(r"(?P<digits>[1-9]\d*)\s*[a-z]*")
_DECIMAL_MARKS = {",", "."}
_ENOUGH = 2  # different numbers below a thousand: a single one may be a code for "nothing heard"
_CLOSEST_M = 1.0  # robots of which no range is longer than this would be one robot


def marks_between_groups(
    rows: Iterable[Sequence[str]], numbers: Collection[int], ranges: Collection[int], source: RadioSource, path: Path
) -> Mapping[int, str]:
    """The mark between groups of three digits, for each column that has one.

    A comma or point before three digits may be a decimal one. It is none where a number has two of them, or another
    one behind it. In ranges a comma is none, either, where decimals would put all of them below a metre, or where
    numbers below a thousand stand beside without decimals. Decimals anywhere in the column, four digits without a
    mark, and ranges from `max_range` on speak against groups.

    Args:
        rows: the cells of each line.
        numbers: the columns that hold numbers.
        ranges: those of them that hold ranges.
        source: the unit and the longest range.
        path: the table, in messages.
    """
    columns = {index: _Column() for index in numbers}
    for cells in rows:
        for index, column in columns.items():
            if index < len(cells):
                column.add(cells[index])
    found = {index: mark for index, column in columns.items() if (mark := column.sure_mark()) is not None}
    for index in set(ranges) - set(found):
        if (sample := columns[index].possible_groups()) is None or metres(1000.0, source.unit) >= source.max_range:
            continue
        if metres(1000.0, source.unit) <= _CLOSEST_M or columns[index].has_short_numbers():
            found[index] = ","
        else:
            logger.warning(
                "%s: %s is read as %s %s; write it without the comma where thousands are meant",
                path, sample, sample.replace(",", "."), source.unit,
            )  # fmt: skip
    for index, mark in found.items():
        logger.info("%s, column %d: %r stands between groups of three digits", path, index + 1, mark)
    return found


class _Column:
    """What the cells of a column say about the marks in them."""

    def __init__(self) -> None:
        self._samples: dict[str, str] = {}  # of each mark that stands before three digits
        self._sure: set[str] = set()
        self._decimal: set[str] = set()
        self._long = False
        self._short: set[str] = set()

    def add(self, cell: str) -> None:
        if match := _GROUPED.fullmatch(cell):
            mark = match["mark"]
            self._samples.setdefault(mark, cell)
            if mark not in _DECIMAL_MARKS or match["more"] or match["fraction"]:
                self._sure.add(mark)
        elif whole := _WHOLE.fullmatch(cell):
            self._long |= len(whole["digits"]) > 3
            if len(self._short) < _ENOUGH:
                self._short.add(whole["digits"])
        else:
            self._decimal |= _DECIMAL_MARKS & set(cell)

    def sure_mark(self) -> str | None:
        """The mark that nothing but groups explains; None where there is none, or more than one."""
        sure = self._sure - self._decimal
        return next(iter(sure)) if len(sure) == 1 else None

    def possible_groups(self) -> str | None:
        """A number whose comma may stand between groups; None where all have decimals."""
        return None if self._long or "," in self._decimal else self._samples.get(",")

    def has_short_numbers(self) -> bool:
        """Whether numbers of at most three digits stand without decimals beside those with a comma."""
        return len(self._short) >= _ENOUGH
