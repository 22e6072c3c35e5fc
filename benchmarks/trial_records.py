"""Outcomes of trials in a file, one JSON line each: a benchmark that was stopped goes on where it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any


class TrialRecords:
    """What was found before, by the trial's key; what is new is written at once.

    Args:
        path: of the file; several processes may append to one, and each knows what was there when it began. None: kept
            nowhere.
    """

    def __init__(self, path: Path | None) -> None:
        self.path = path
        lines = path.read_text().splitlines() if path is not None and path.exists() else []
        self.known: dict[str, dict[str, Any]] = dict(map(json.loads, lines))

    def outcome(self, key: str, run: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """Of a trial: the one that is known, or what `run` finds."""
        if key not in self.known:
            self.known[key] = run()
            if self.path is not None:
                with self.path.open("a") as file:
                    file.write(json.dumps([key, self.known[key]]) + "\n")
        return self.known[key]
