"""Comparisons as tables for the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.box import SIMPLE_HEAD
from rich.table import Table

from wiclosure.pipeline.comparison.figures import FIGURES, summaries
from wiclosure.pipeline.comparison.outcomes import Comparison
from wiclosure.pipeline.comparison.tables import arm_rows

SHOWN = ("ate_m", "accepted_true", "accepted_false", "missed_percent", "closing_s")
"""Figures that matter most."""


def comparison_table(comparison: Comparison) -> Table:
    """What matters most of each arm: medians and spread."""
    header, rows = arm_rows(summaries(comparison), SHOWN)
    table = _table("comparison")
    table.add_column(header[0], style="bold", no_wrap=True)
    for title in header[1:]:
        table.add_column(title, justify="right", min_width=9 if title == FIGURES["ate_m"].label else None)
    for row in rows:
        table.add_row(*row)
    return table


def reproduction_table(title: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> Table:
    """The paper's columns, then ours."""
    table = _table(title)
    table.add_column(header[0], no_wrap=True)
    for column in header[1:]:
        table.add_column(column.replace(": ", "\n"), justify="right")
    for row in rows:
        table.add_row(*row)
    return table


def _table(title: str) -> Table:
    return Table(title=title, title_justify="left", title_style="bold", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
