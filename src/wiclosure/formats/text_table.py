"""Tables of text: CSV, TSV, semicolons or white space, with a header line or without."""

from __future__ import annotations

import codecs
import csv
import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from wiclosure.errors import InputError

_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf(inity)?)", re.IGNORECASE)
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
_SAMPLE_LINES = 50
_SAMPLE_BYTES = 65_536
_DELIMITERS = ("\t", ";", ",")
SPACE = " "
"""The delimiter that stands for any white space."""


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table whose rows are read as they are asked for.

    Args:
        path: the file.
        columns: their names; without a header line `1`, `2`, ...
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

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Line numbers from 1, and cells; blank lines and comments are left out.

        Raises:
            InputError: the file cannot be read, or is no text.
        """
        with _reading(self.path):
            for number, line in _lines(self.path, self.encoding):
                if number >= self.first_line and line.strip() and not line.lstrip().startswith("#"):
                    yield number, _cells(line, self.delimiter)


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
    encoding = _encoding(path)
    with _reading(path):
        head = list(islice(_lines(path, encoding), _SAMPLE_LINES))
    content = [(number, line) for number, line in head if line.strip() and not line.lstrip().startswith("#")]
    if not content:
        raise InputError(f"{path} holds no rows; expected a table of measurements, one a line")
    delimiter = delimiter or _delimiter([line for _, line in content])
    first = _cells(content[0][1], delimiter)
    if names:
        start = content[0][0] + (not any(map(is_number, first)))
        return TextTable(path, tuple(names), delimiter, False, start, encoding)
    if not any(map(is_number, first)) or set(first) & set(expected):
        return TextTable(path, tuple(first), delimiter, True, content[0][0] + 1, encoding)
    commented = [line.lstrip()[1:] for number, line in head if line.lstrip().startswith("#") and number < content[0][0]]
    header = _cells(commented[-1].strip(), delimiter) if commented else []
    if len(header) == len(first) and not any(map(is_number, header)):
        return TextTable(path, tuple(header), delimiter, True, content[0][0], encoding)
    columns = tuple(str(number) for number in range(1, len(first) + 1))
    return TextTable(path, columns, delimiter, False, content[0][0], encoding)


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


def _delimiter(lines: Sequence[str]) -> str:
    """The one that cuts most lines into equally many cells, more than one; else white space."""
    best, best_share = SPACE, 0.0
    for delimiter in _DELIMITERS:
        counts = Counter(len(_cells(line, delimiter)) for line in lines)
        width, times = counts.most_common(1)[0]
        if width > 1 and times / len(lines) > max(best_share, 0.5):
            best, best_share = delimiter, times / len(lines)
    return best


def _cells(line: str, delimiter: str) -> list[str]:
    line = line.rstrip("\r\n")
    if delimiter == SPACE:
        return line.split()
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _lines(path: Path, encoding: str) -> Iterator[tuple[int, str]]:
    with path.open(encoding=encoding, errors="replace", newline=None) as file:  # a bad byte spoils one row
        yield from enumerate(file, start=1)


def _encoding(path: Path) -> str:
    """UTF-8; UTF-16 where the first bytes say so, as spreadsheets write it; else that of Windows in the west.

    Raises:
        InputError: bytes that no text has.
    """
    with _reading(path), path.open("rb") as file:
        head = file.read(_SAMPLE_BYTES)
    if head[:2] in {b"\xff\xfe", b"\xfe\xff"}:
        return "utf-16"
    if b"\0" in head:
        raise InputError(f"{path} is not a table of text (it holds zero bytes); expected rows of cells")
    try:
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Turns errors of reading a text file into one line."""
    try:
        yield
    except OSError as error:
        raise InputError(f"cannot read the table {path}: {error.strerror}; check the path") from error
    except (UnicodeError, csv.Error) as error:
        raise InputError(f"{path} is not a table of text ({error}); expected rows of cells") from error
