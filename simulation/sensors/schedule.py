"""When robots can talk to each other."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from wiclosure.errors import InputError
from wiclosure.settings import Settings
from wiclosure.types import FloatArray


class LinkWindow(Settings):
    """A time in which a link is up."""

    start_s: float = Field(ge=0, description="s since the mission's start")
    end_s: float = Field(ge=0, description="s since the mission's start")
    robot_a: str = Field("", description="one end of the link; empty: any robot")
    robot_b: str = Field("", description="the other end; empty: any robot")

    def applies_to(self, robot_a: str, robot_b: str) -> bool:
        """Whether the window is about the link between these robots."""
        ends = {robot_a, robot_b}
        return all(robot in ends for robot in (self.robot_a, self.robot_b) if robot)


def link_is_up(
    windows: Sequence[LinkWindow] | None, robot_a: str, robot_b: str, time_s: FloatArray
) -> NDArray[np.bool_]:
    """Whether the link is up at each time `(N,)`: in its windows; always, where there is no schedule."""
    if windows is None:
        return np.ones(len(time_s), bool)
    mine = [window for window in windows if window.applies_to(robot_a, robot_b)]
    start = np.array([window.start_s for window in mine])[:, None]
    end = np.array([window.end_s for window in mine])[:, None]
    return np.asarray(((time_s >= start) & (time_s <= end)).any(axis=0))


def read_schedule(path: Path) -> tuple[LinkWindow, ...]:
    """Reads a CSV file with the columns `start_s,end_s` and, optionally, `robot_a,robot_b`.

    Raises:
        InputError: the file cannot be read, lacks a column, or a line is wrong (named with its number).
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = csv.DictReader(file, skipinitialspace=True)
            columns = set(rows.fieldnames or ())
            if not {"start_s", "end_s"} <= columns or not columns <= set(LinkWindow.model_fields):
                raise InputError(
                    f"{path}: the columns are {', '.join(sorted(columns)) or 'none'};"
                    " expected start_s,end_s and optionally robot_a,robot_b"
                )
            return tuple(_window(path, rows.line_num, row) for row in rows)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path}: cannot read the radio schedule ({error}); give a CSV file") from error


def _window(path: Path, line: int, row: dict[str | None, Any]) -> LinkWindow:
    if None in row or None in row.values():
        raise InputError(f"{path}, line {line}: {'more' if None in row else 'fewer'} values than columns")
    try:
        window = LinkWindow.model_validate(row)
    except ValidationError as error:
        got = f"{row['start_s']!r} and {row['end_s']!r}"
        raise InputError(f"{path}, line {line}: start_s and end_s must be seconds >= 0, got {got}") from error
    if window.end_s < window.start_s:
        raise InputError(
            f"{path}, line {line}: the window ends ({window.end_s} s) before it starts ({window.start_s} s)"
        )
    if window.robot_a and window.robot_a == window.robot_b:
        raise InputError(f"{path}, line {line}: a link has two ends, and both are {window.robot_a}")
    return window
