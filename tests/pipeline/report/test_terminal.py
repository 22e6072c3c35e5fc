"""What commands print fits terminals of 60 to 200 columns, word by word."""

from __future__ import annotations

import io
import re
import sys
from collections.abc import Callable

import pytest
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from wiclosure.pipeline.report import tables
from wiclosure.pipeline.report.terminal import Fitted, show
from wiclosure.pipeline.stages.run_result import RunResult

WIDTHS = (60, 80, 120, 200)
SENTENCE = "alpha and beta: contradicts the radio consistency check of 12 measurements; look at radio.jsonl"


def lines_of(table: Table, width: int) -> list[str]:
    out = io.StringIO()
    Console(file=out, width=width, color_system=None).print(Fitted(table))
    return out.getvalue().splitlines()


def words_of(table: Table) -> set[str]:
    """All words of headers and cells."""
    texts = [str(text) for column in table.columns for text in [column.header, *column.cells]]
    console = Console()
    return {word for text in texts for word in console.render_str(text).plain.split()}


def wide() -> Table:
    names = ("arm", "runs", "ATE, m", "true closures", "false closures", "rejected false, %", "closing time, s")
    table = Table(title="comparison")
    for name in names:
        table.add_column(name, justify="right")
    for arm in ("none", "wiclosure", "range-gate"):
        table.add_row(arm, "5", "not connected [0.036, not connected]", "1,234", "15", "98.7", "0.47 [0.31, 12.20]")
    return table


def with_remarks() -> Table:
    table = Table(title="run", show_header=False)
    table.add_column(style="dim")
    table.add_column(overflow="fold")
    table.add_row("candidate pairs", "640 of 6,400 kept (10.00 %)")
    table.add_row("remarks", SENTENCE)
    return table


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("make", [wide, with_remarks])
def test_no_word_is_cut(make: Callable[[], Table], width: int) -> None:
    table = make()
    words = words_of(table)
    lines = lines_of(table, width)
    assert max(map(len, lines)) <= width
    shown = {word for line in lines for word in re.split(r"[\s│┃|]+", line)}
    assert words <= shown


@pytest.mark.parametrize("width", WIDTHS)
def test_a_run_and_a_filter_fit(run_of: Callable[..., RunResult], width: int) -> None:
    run = run_of(("alpha", "beta", "gamma"))
    for made in (tables.run_table(run.metrics), tables.filter_table(run.solution.filtered)):
        words = words_of(made)
        lines = lines_of(made, width)
        assert max(map(len, lines)) <= width
        assert words <= {word for line in lines for word in re.split(r"[\s│┃|]+", line)}


def test_a_narrow_terminal_gets_one_row_below_the_other() -> None:
    lines = [line.strip() for line in lines_of(wide(), 60)]
    assert any(line.startswith("false closures") and line.endswith("15") for line in lines)


def test_sentences_stay_on_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    path = "results/" + 30 * "deep/" + "[bold]"
    show(f"results in {path}")
    assert capsys.readouterr().out == f"results in {path}\n"


def test_no_color_leaves_no_codes(monkeypatch: pytest.MonkeyPatch) -> None:
    class Screen(io.StringIO):
        def isatty(self) -> bool:
            return True

    table = Table(title="[bold]title[/bold]")
    table.add_column("what", style="bold red")
    table.add_row(escape("[x]"))
    found = {}
    for value in ("", "1"):
        monkeypatch.setenv("TERM", "xterm-256color")
        monkeypatch.setenv("NO_COLOR", value)
        screen = Screen()
        monkeypatch.setattr(sys, "stdout", screen)
        show(table, "done")
        found[value] = screen.getvalue()
    assert "\x1b" in found[""]
    assert "\x1b" not in found["1"]
