"""Progress bars on the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import TypeVar

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    ProgressColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as Bars
from rich.text import Text

from wiclosure.pipeline.report.terminal import moves_cursor, terminal

_Item = TypeVar("_Item")


class BarProgress:
    """One bar for each piece of work, on standard error; nothing where that is not a terminal."""

    def track(self, items: Iterable[_Item], label: str, total: int | None = None) -> Iterator[_Item]:
        """The same items, with a bar."""
        with _bars() as bars:
            yield from bars.track(items, total=total, description=label)

    @contextmanager
    def together(self, totals: Mapping[str, int], label: str) -> Iterator[Callable[[str, int], None]]:
        """One bar per piece, with items per second."""
        with _bars() as bars:
            tasks = {name: bars.add_task(f"{label} {name}", total=total or None) for name, total in totals.items()}

            def show(name: str, done: int) -> None:
                bars.update(tasks[name], completed=done)

            yield show


class _Speed(ProgressColumn):
    """Items per second, over the whole time."""

    def render(self, task: Task) -> Text:
        speed = task.completed / task.elapsed if task.elapsed else 0.0
        return Text(f"{speed:.1f}/s" if speed else "")


def _bars() -> Bars:
    return Bars(
        TextColumn("{task.description:<28}"),
        BarColumn(bar_width=32),
        MofNCompleteColumn(),
        _Speed(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
        console=terminal(sys.stderr),
        disable=not moves_cursor(),
    )
