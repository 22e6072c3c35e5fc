"""Radio logs, their presets and what a check found, as tables for the terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rich.markup import escape
from rich.table import Table

from wiclosure.pipeline.radio.check.check import CheckResult
from wiclosure.pipeline.radio.presets import Preset
from wiclosure.pipeline.radio.read import RadioReading
from wiclosure.pipeline.radio.summary import PairSummary, pair_summaries

_MARKS = {"good": "[green]fits[/green]", "note": "note", "suspect": "[bold red]suspect[/bold red]"}


def radio_table(reading: RadioReading) -> Table:
    """A row for each pair of robots (least, median and greatest range), and below it what was left out."""
    account, pairs = reading.account, pair_summaries(reading.log)
    since = f", from {min(pair.first_ns for pair in pairs) * 1e-9:.3f} s" if pairs else ""
    table = Table(title=f"radio log read as {reading.kind}{since}")
    for column in ("robots", "ranges", "bearings", "range m", "sigma m", "for s", "every s"):
        table.add_column(column, no_wrap=column == "range m", overflow="fold")
    for pair in pairs:
        table.add_row(*_cells(pair))
    remarks = [] if account is None else [*account.notes, *account.sentences()]
    if reading.log.headings:
        remarks.append(f"{len(reading.log.headings)} headings")
    if remarks:
        table.caption = escape("\n".join(f"{remark}." for remark in remarks))
        table.caption_justify = "left"
    return table


def check_table(result: CheckResult) -> Table:
    """A row for each finding, and below it the keys to add."""
    table = Table(title="radio log against trajectories")
    for column in ("robots", "what", "", "found", "to correct"):
        table.add_column(column, overflow="fold")
    for finding in result.findings:
        pair = "all" if finding.pair is None else "-".join(finding.pair)
        table.add_row(pair, finding.topic, _MARKS[finding.level], escape(finding.text), escape(finding.advice))
    if result.settings:
        keys = ", ".join(f"{key}: {value}" for key, value in result.settings.items())
        table.caption = escape(
            f"Add to the source in dataset.yaml, or behind the log's path on the command line: {keys}"
        )
        table.caption_justify = "left"
    return table


def presets_table(presets: Mapping[str, Preset]) -> Table:
    """A row for each preset."""
    table = Table(title="presets of radio logs")
    for column in ("preset", "what", "taken by itself for"):
        table.add_column(column, overflow="fold")
    for preset in presets.values():
        alone = ", ".join(preset.messages) or (f"columns {', '.join(preset.header)}" if preset.header else "")
        table.add_row(preset.name, escape(preset.about), escape(alone))
    return table


def _cells(pair: PairSummary) -> list[str]:
    low, middle, high = pair.range_quantiles_m
    return [
        "-".join(pair.robots),
        str(pair.ranges),
        str(pair.bearings),
        "-" if math.isnan(middle) else f"{low:.1f} .. {middle:.1f} .. {high:.1f}",
        _number(pair.sigma_m),
        f"{(pair.last_ns - pair.first_ns) * 1e-9:.1f}",
        _number(pair.interval_s),
    ]


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.3g}"
