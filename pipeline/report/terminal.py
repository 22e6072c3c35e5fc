"""What commands print: tables that fit the terminal without cutting words, and sentences."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from typing import TextIO

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text


def show(*parts: Table | str) -> None:
    """Prints tables, fitted to the terminal, and sentences, each on one line however long: paths stay whole."""
    console = terminal()
    for part in parts:
        if isinstance(part, str):
            console.print(Text(part), soft_wrap=True)
        else:
            console.print(Fitted(part))


def terminal(file: TextIO | None = None) -> Console:
    """A console, standard output unless told otherwise; with `NO_COLOR` set it writes no codes at all."""
    return Console(file=file, color_system=None if plain() else "auto", highlight=False)


def plain() -> bool:
    """Whether the user wants no codes (no-color.org)."""
    return bool(os.environ.get("NO_COLOR"))


def moves_cursor() -> bool:
    """Whether bars can be drawn: standard error is a terminal that takes codes."""
    return sys.stderr.isatty() and not plain()


class Fitted:
    """A table as it is where every word fits its column; else each of its rows below the other, cell by cell."""

    def __init__(self, table: Table) -> None:
        self._table = table

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        table = self._table
        widths = _widths(console, table, options.max_width)
        if widths is None:
            yield _stacked(table)
            return
        for column, width in zip(table.columns, widths, strict=True):
            column.width = width
        yield table


def _widths(console: Console, table: Table, most: int) -> list[int] | None:
    """Width of each column: its longest word at least, the rest shared by those that need more; None: no room."""
    texts = [_texts(console, table, n) for n in range(len(table.columns))]
    least = [max((length for text in of for length in _word_lengths(text)), default=1) for of in texts]
    whole = [max((line.cell_len for text in of for line in text.split()), default=1) for of in texts]
    whole = [max(pair) for pair in zip(least, whole, strict=True)]
    for n, column in enumerate(table.columns):
        if column.no_wrap:
            least[n] = whole[n]
    unlimited = Measurement.get(console, console.options.update(width=10**6), table).maximum
    borders = unlimited - sum(_rich_widths(console, table))
    left = most - borders - sum(least)
    if left < 0:
        return None
    wanted = [full - word for full, word in zip(whole, least, strict=True)]
    if sum(wanted) <= left:
        return whole
    widths = list(least)
    for done, n in enumerate(sorted(range(len(wanted)), key=wanted.__getitem__)):  # short columns stay whole
        given = min(wanted[n], left // (len(wanted) - done))
        widths[n], left = widths[n] + given, left - given
    return widths


def _rich_widths(console: Console, table: Table) -> list[int]:
    """Widths of the columns alone, as rich would have them without a limit."""
    found = []
    for n, column in enumerate(table.columns):
        lines = [line.cell_len for text in _texts(console, table, n) for line in text.split()]
        found.append(max([1, *lines, column.min_width or 0]))
    return found


def _texts(console: Console, table: Table, number: int) -> list[Text]:
    """Header and cells of a column."""
    column = table.columns[number]
    header = [column.header] if table.show_header else []
    return [console.render_str(str(cell)) for cell in [*header, *column.cells]]


def _word_lengths(text: Text) -> Iterator[int]:
    """Of each word; of the first in a line with what it is indented by."""
    for line in text.plain.splitlines():
        for n, word in enumerate(line.split()):
            indent = len(line) - len(line.lstrip()) if n == 0 else 0
            yield indent + cell_len(word)


def _stacked(table: Table) -> Table:
    """A block for each row: the column's header, and the cell."""
    stacked = Table(
        title=table.title,
        title_justify="left",
        title_style=table.title_style,
        caption=table.caption,
        caption_justify=table.caption_justify,
        box=None,
        show_header=False,
        pad_edge=False,
    )
    stacked.add_column(style="dim", overflow="fold")
    stacked.add_column(overflow="fold")
    for n, cells in enumerate(zip(*(column.cells for column in table.columns), strict=True)):
        if n:
            stacked.add_row("", "")
        for column, cell in zip(table.columns, cells, strict=True):
            stacked.add_row(str(column.header).replace("\n", " ") if table.show_header else "", cell)
    return stacked
