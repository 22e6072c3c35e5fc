"""Tables of text: CSV, TSV, semicolons, bars, white space or JSON; with a line of names or without."""

from __future__ import annotations

import codecs
import csv
import logging
import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from wiclosure.errors import InputError
from wiclosure.formats.text_cells import JSON, SPACE, cells_of, empty_at_end, is_number, json_cells

logger = logging.getLogger(__name__)

_SAMPLE_LINES = 50
_ZIP = b"PK\x03\x04"  # what .xlsx and .ods begin with
_SAMPLE_BYTES = 65_536
_MOST_LINES = 2000  # among which so many lines of the table are looked for
_DELIMITERS = ("\t", ";", ",", "|")
_REMARK = re.compile(r"\s*(#|%|//|;)+\s*")
_ABSENT = {"", "-", "na", "n/a", "none", "null"}
_UNITS = {"m", "mm", "cm", "ft", "in", "s", "ms", "us", "ns", "sec", "rad", "deg"}


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table whose rows are read as they are asked for.

    Args:
        path: the file.
        columns: their names; without a header line `1`, `2`, ...
        units: of the columns, where a line below their names states them; empty words for those that have none.
        delimiter: between the cells; a space stands for any white space.
        has_header: whether a line of the file names the columns.
        first_line: number of the line where the rows begin, from 1.
        encoding: of the text.
    """

    path: Path
    columns: tuple[str, ...]
    delimiter: str
    has_header: bool
    first_line: int
    encoding: str
    units: tuple[str, ...] = ()

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line numbers from 1, and cells; blank lines and comments are left out.

        Raises:
            InputError: the file cannot be read, or is no text.
        """
        with _reading(self.path):
            for number, line in _lines(self.path, self.encoding):
                if number >= self.first_line and line.strip() and not line.lstrip().startswith("#"):
                    yield number, self._row(line)

    def _row(self, line: str) -> list[str]:
        if self.delimiter == JSON:
            found = json_cells(line)
            return [found.get(column, "") for column in self.columns] if found else [line.strip()]
        cells = cells_of(line, self.delimiter)
        return cells[: max(len(self.columns), len(cells) - empty_at_end(cells))]


def open_table(
    path: Path, *, delimiter: str | None = None, names: Sequence[str] = (), expected: Collection[str] = ()
) -> TextTable:
    """Looks at the first lines of a table.

    Args:
        path: the file.
        delimiter: between the cells; None finds it.
        names: of the columns, where no line names them.
        expected: names that a header line would have.

    Raises:
        InputError: the file cannot be read, is no text, or holds no rows.
    """
    with _reading(path):
        encoding = encoding_of(path)
        head = list(_head(path, encoding))
    content = [(number, line) for number, line in head if not line.lstrip().startswith("#")]
    if not content:
        raise InputError(f"{path} holds no rows; expected a table of measurements, one a line")
    if delimiter is None and content[0][1].lstrip().startswith(JSON) and (keys := json_cells(content[0][1])):
        return TextTable(path, tuple(keys), JSON, True, content[0][0], encoding)
    delimiter = delimiter or _delimiter([line for _, line in content])
    lines = [(number, cells_of(line, delimiter)) for number, line in content]
    start = _start([cells for _, cells in lines])
    if not _measures([cells for _, cells in lines[start:]]):
        raise InputError(f"{path} is text without rows of numbers; expected a table of measurements, one a line")
    before = [line for number, line in head if number < lines[start][0]]
    if start:
        logger.warning(
            "%s: the table begins on line %d; what stands before it was left out (%s)", path, lines[start][0],
            content[0][1].strip()[:40],
        )  # fmt: skip
    return _named(path, lines[start:], before, delimiter, encoding, names, expected)


def _named(
    path: Path,
    lines: Sequence[tuple[int, list[str]]],
    before: Sequence[str],
    delimiter: str,
    encoding: str,
    names: Sequence[str],
    expected: Collection[str],
) -> TextTable:
    """The table of these lines, with the names of its columns; `before` are the lines above it."""
    number, first = lines[0]
    body = [cells for _, cells in lines[1:]]
    if names:
        start = number + (not any(map(is_number, first)))
        return TextTable(path, tuple(names), delimiter, False, start, encoding)
    if _names_columns(first, body) or set(first) & set(expected):
        units = tuple(body[0]) if body and _are_units(body[0], len(first)) else ()
        return TextTable(path, tuple(first), delimiter, True, number + 1 + bool(units), encoding, _plain(units))
    remarks = [cells_of(_REMARK.sub("", line, count=1).strip(), delimiter) for line in before if _REMARK.match(line)]
    named = [cells for cells in remarks if len(cells) == len(first) and not any(map(is_number, cells))]
    if named:
        units = tuple(named.pop()) if len(named) > 1 and _are_units(named[-1], len(first)) else ()
        return TextTable(path, tuple(named[-1]), delimiter, True, number, encoding, _plain(units))
    columns = tuple(str(column) for column in range(1, len(first) + 1))
    return TextTable(path, columns, delimiter, False, number, encoding)


def _head(path: Path, encoding: str) -> Iterator[tuple[int, str]]:
    """The first lines that are not blank, comments too, until there are enough of the table."""
    rows = 0
    for number, line in islice(_lines(path, encoding), _MOST_LINES):
        if line.strip():
            yield number, line
            rows += not line.lstrip().startswith("#")
        if rows == _SAMPLE_LINES:
            return


def _start(lines: Sequence[Sequence[str]]) -> int:
    """Which line the table begins with: the first as wide as most are; rows may end in delimiters, names not."""
    width, times = Counter(map(len, lines)).most_common(1)[0]
    if times < len(lines) / 2:
        return 0
    empty = min(empty_at_end(cells) for cells in lines if len(cells) == width)
    return next(n for n, cells in enumerate(lines) if width - empty <= len(cells) <= width)


def _measures(lines: Sequence[Sequence[str]]) -> bool:
    """Whether at least every other row below the first, if there are any, has a cell that begins as a number does."""
    rows = lines[1:]
    return 2 * sum(any(cell.lstrip("+-.'\"")[:1].isdigit() for cell in cells) for cells in rows) >= len(rows)


def _names_columns(first: Sequence[str], body: Sequence[Sequence[str]]) -> bool:
    """Whether the first line names columns: it has no numbers, or words where others have numbers, or it counts."""
    if not any(map(is_number, first)):
        return True
    if len(first) > 2 and body and list(body[0]) != list(first):
        for start in (0, 1):
            if list(first) == [str(start + column) for column in range(len(first))]:
                return True
    return any(
        cell.casefold() not in _ABSENT
        and not is_number(cell)
        and bool(body)
        and sum(is_number(cells[column]) for cells in body if column < len(cells)) > len(body) / 2
        for column, cell in enumerate(first)
    )


def _are_units(cells: Sequence[str], width: int) -> bool:
    """Whether a line below the names states units, as `[s], -, -, [m]`."""
    words = _plain(cells)
    return len(cells) == width and not any(map(is_number, cells)) and bool(set(words) & _UNITS)


def _plain(units: Sequence[str]) -> tuple[str, ...]:
    return tuple(unit.strip("[]()").casefold() for unit in units)


def _delimiter(lines: Sequence[str]) -> str:
    """The one that cuts most lines into equally many cells, more than one; else white space."""
    best, best_share = SPACE, 0.0
    for delimiter in _DELIMITERS:
        counts = Counter(len(cells_of(line, delimiter)) for line in lines)
        width, times = counts.most_common(1)[0]
        if width > 1 and times / len(lines) > max(best_share, 0.5):
            best, best_share = delimiter, times / len(lines)
    return best


def _lines(path: Path, encoding: str) -> Iterator[tuple[int, str]]:
    with path.open(encoding=encoding, errors="replace", newline=None) as file:  # a bad byte spoils one row
        yield from enumerate(file, start=1)


def encoding_of(path: Path) -> str:
    """UTF-8; UTF-16 where the first bytes say so, as spreadsheets write it; else that of Windows in the west.

    Raises:
        InputError: bytes that no text has.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(_SAMPLE_BYTES)
    if (wide := utf16_of(head)) is not None:
        return wide
    if b"\0" in head:
        way_out = "save it as CSV" if head.startswith(_ZIP) else "expected rows of cells"
        raise InputError(f"{path} is not a table of text (it holds zero bytes); {way_out}")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def utf16_of(head: bytes) -> str | None:
    """The UTF-16 that a file is in, by its first bytes; None where it is in none."""
    if head[:2] in {b"\xff\xfe", b"\xfe\xff"}:
        return "utf-16"
    for encoding, other in (("utf-16-le", head[1::2]), ("utf-16-be", head[::2])):
        if len(head) > 1 and other.count(0) > 0.9 * len(other) and head.count(0) < 0.6 * len(head):
            return encoding
    return None


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turns errors of reading a text file into one line."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot read the table {path}: {error.strerror}; check the path") from error
    except (UnicodeError, csv.Error) as error:
        raise InputError(f"{path} is not a table of text ({error}); expected rows of cells") from error
