"""The log of a run, one JSON object per line."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path


class _JsonLines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return json.dumps(
            {
                "time": datetime.fromtimestamp(record.created, UTC).isoformat(),
                "level": record.levelname.lower(),
                "module": record.name.removeprefix("wiclosure."),
                "message": record.getMessage(),
            }
        )


@contextmanager
def json_log(path: Path) -> Iterator[None]:
    """Writes what the package logs inside the block to `path`."""
    logger = logging.getLogger("wiclosure")
    handler = logging.FileHandler(path, encoding="utf-8")
    handler.setFormatter(_JsonLines())
    level = logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        handler.close()


@contextmanager
def warnings_on_terminal() -> Iterator[None]:
    """Shows warnings of the package as one line each on standard error."""
    logger = logging.getLogger("wiclosure")
    handler = logging.StreamHandler()
    handler.setLevel(logging.WARNING)
    handler.setFormatter(logging.Formatter("wiclosure: warning: %(message)s"))
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)
