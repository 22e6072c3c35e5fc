"""Rows of tables and of lines of text."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from wiclosure.errors import ConfigError, InputError
from wiclosure.formats.name_pattern import NamePattern
from wiclosure.formats.text_cells import JSON, SPACE, is_number, with_decimal_point
from wiclosure.formats.text_table import TextTable, open_table
from wiclosure.pipeline.radio.readers.column_names import guessed_fields
from wiclosure.pipeline.radio.readers.digit_groups import marks_between_groups
from wiclosure.pipeline.radio.readers.rows import Row
from wiclosure.pipeline.radio.source import RadioSource

_DELIMITERS = {"space": SPACE, "tab": "\t", "comma": ",", "semicolon": ";", " ": SPACE}
_WORDS = ("from", "to", "valid")
_PLAIN = ("from_", "to", "range_variance", "valid", "azimuth", "elevation", "x", "y", "z")


def table_rows(table: TextTable, source: RadioSource) -> tuple[Iterator[Row], RadioSource]:
    """One row for each range column of each line, and the source with what was guessed of it.

    Raises:
        InputError: no such column, or none is named and none can be guessed.
    """
    named = table.has_header or bool(source.columns)
    source = guessed_fields(table.columns, source, table.path, has_header=named, units=table.units)
    return _rows(table, source, _Columns(table, source)), source


def opened(path: Path, source: RadioSource) -> TextTable:
    """The table by the source's delimiter and names.

    Raises:
        InputError: see `open_table`.
        ConfigError: a delimiter of several characters.
    """
    delimiter = None if source.delimiter is None else _DELIMITERS.get(source.delimiter, source.delimiter)
    if delimiter is not None and len(delimiter) != 1:
        raise ConfigError(f"delimiter is {source.delimiter!r}; expected one character, space, tab, comma or semicolon")
    named = [*source.stamp, *source.range_, *(getattr(source, key) for key in _PLAIN)]
    return open_table(
        path,
        delimiter=delimiter,
        names=source.columns,
        expected={name for name in named if name is not None and not is_number(name)},
    )


class _Columns:
    """Where in a line each field stands: one mapping for each measurement of a line."""

    def __init__(self, table: TextTable, source: RadioSource) -> None:
        self._table = table
        shared = {
            key.removesuffix("_"): self._index(getattr(source, key))
            for key in _PLAIN
            if getattr(source, key) is not None
        }
        if isinstance(source.bearing_sigma, str):
            shared["bearing_sigma"] = self._index(source.bearing_sigma)
        for key, limit in zip(("range_low", "range_high"), source.range_limits or (), strict=False):
            if isinstance(limit, str):
                shared[key] = self._index(limit)
        self.stamp = [self._index(name) for name in source.stamp]
        self.groups: list[tuple[Mapping[str, int], Mapping[str, str]]] = []
        for name in source.range_:
            for column, ids in self._family(name):
                group = {**shared, "range": self._index(column)}
                if isinstance(source.range_sigma, str):
                    group["range_sigma"] = self._index(NamePattern(source.range_sigma).filled(ids))
                self.groups.append((group, ids))
        if not source.range_:
            self.groups.append((shared, {}))
        self.ranges = {group["range"] for group, _ in self.groups if "range" in group}
        fields = [(key, index) for group, _ in self.groups for key, index in group.items()]
        self.numbers = {*self.stamp, *(index for key, index in fields if key not in _WORDS)}

    def _family(self, name: str) -> list[tuple[str, dict[str, str]]]:
        pattern = NamePattern(name)
        if not pattern.is_family:
            return [(name, {})]
        found = [(column, ids) for column in self._table.columns if (ids := pattern.match(column)) is not None]
        if not found:
            raise self._missing(name)
        return found

    def _index(self, name: str) -> int:
        columns = self._table.columns
        if name in columns:
            return columns.index(name)
        if name.isdigit() and 1 <= int(name) <= len(columns):
            return int(name) - 1
        raise self._missing(name)

    def _missing(self, name: str) -> InputError:
        shown = ", ".join(self._table.columns[:20])
        return InputError(
            f"{self._table.path} has no column {name!r}; its columns: {shown} (or their numbers, 1 to"
            f" {len(self._table.columns)})"
        )


def _rows(table: TextTable, source: RadioSource, columns: _Columns) -> Iterator[Row]:
    limits = {
        key: limit
        for key, limit in zip(("range_low", "range_high"), source.range_limits or (), strict=False)
        if isinstance(limit, float)
    }
    comma = table.delimiter not in {",", JSON}
    width = len(table.columns)
    content = (cells for _, cells in table.rows())
    marks = marks_between_groups(content, columns.numbers, columns.ranges, source, table.path)
    for number, cells in table.rows():
        place = f"line {number}"
        if len(cells) > width or len(cells) <= _last(columns):
            yield Row(place, {}, f"{len(cells)} cells, expected {width}")
            continue
        whole = [cell.replace(marks[index], "") if index in marks else cell for index, cell in enumerate(cells)]
        plain = [with_decimal_point(cell) for cell in whole] if comma else whole
        stamp = tuple(plain[index] for index in columns.stamp)
        for group, ids in columns.groups:
            values = {key: plain[index] for key, index in group.items()}
            yield Row(place, {**limits, **ids, **values, "stamp": stamp if len(stamp) > 1 else stamp[0]})


def _last(columns: _Columns) -> int:
    return max([*columns.stamp, *(index for group, _ in columns.groups for index in group.values())])


def line_rows(path: Path, source: RadioSource) -> Iterator[Row]:
    """One row for each place where `pattern` fits; the time is its group `stamp`, or the first number of the line.

    Raises:
        InputError: the file cannot be read, or is no text.
        ConfigError: no pattern, or one that is none.
    """
    if source.pattern is None:
        raise ConfigError(f"{path}: lines need a pattern, a regular expression with groups such as to and range")
    try:
        pattern = re.compile(source.pattern)
    except re.error as error:
        raise ConfigError(f"pattern {source.pattern!r} is no regular expression: {error}") from error
    return _line_rows(path, pattern)


def _line_rows(path: Path, pattern: re.Pattern[str]) -> Iterator[Row]:
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            for number, line in enumerate(file, start=1):
                if "\0" in line:
                    raise InputError(f"{path} is no text (line {number} holds zero bytes); expected lines of a log")
                if line.strip() and not line.lstrip().startswith("#"):
                    yield from _matches(f"line {number}", line, pattern)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}; check the path") from error


def _matches(place: str, line: str, pattern: re.Pattern[str]) -> Sequence[Row]:
    first = re.split(r"[\s,;]+", line.strip(), maxsplit=1)[0]
    rows = [Row(place, {"stamp": first, **match.groupdict()}) for match in pattern.finditer(line)]
    return rows or [Row(place, {}, "the pattern fits nowhere")]
