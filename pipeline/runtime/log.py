"""The log of a run, one JSON object per line."""

from __future__ import annotations

import json
import logging
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from logging.handlers import QueueHandler
from pathlib import Path
from queue import SimpleQueue

from wiclosure.errors import printable


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


class _LogFile(logging.FileHandler):
    """Raises what cannot be written, as a full disk, where it is logged: the run writes there as well."""

    def handleError(self, record: logging.LogRecord) -> None:
        raise  # noqa: PLE0704  -- called while the error is handled

    def close(self) -> None:
        with suppress(OSError):  # what waits to be written to a full disk; whoever wrote it has been told
            super().close()


@contextmanager
def json_log(path: Path) -> Iterator[None]:
    """Writes what the package logs inside the block to `path`."""
    logger = logging.getLogger("wiclosure")
    handler = _LogFile(path, encoding="utf-8")
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


class _OneLine(logging.Formatter):
    """Names in inputs may hold anything: line ends, and what terminals obey."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        return printable(super().formatMessage(record))


class _Once(logging.Filter):
    """Lets each sentence through once: a file that is opened again and again has the same to be said of it."""

    def __init__(self) -> None:
        super().__init__()
        self._said: set[str] = set()

    def filter(self, record: logging.LogRecord) -> bool:
        sentence = record.getMessage()
        is_new = sentence not in self._said
        self._said.add(sentence)
        return is_new


@contextmanager
def warnings_on_terminal() -> Iterator[None]:
    """Shows warnings of the package as one line each on standard error, none twice."""
    logger = logging.getLogger("wiclosure")
    handler = logging.StreamHandler()
    handler.setLevel(logging.WARNING)
    handler.addFilter(_Once())
    handler.setFormatter(_OneLine("wiclosure: warning: %(message)s"))
    logger.addHandler(handler)
    try:
        yield
    finally:
        logger.removeHandler(handler)


@contextmanager
def collected() -> Iterator[list[logging.LogRecord]]:
    """What the package logs inside the block, in a form that can be sent to another process."""
    logger, queue, records = logging.getLogger("wiclosure"), SimpleQueue[logging.LogRecord](), list[logging.LogRecord]()
    handler, level = QueueHandler(queue), logger.level
    logger.addHandler(handler)
    logger.setLevel(logging.INFO)
    try:
        yield records
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        while not queue.empty():
            records.append(queue.get())


def logged_again(records: Iterable[logging.LogRecord]) -> None:
    """Here, what was collected elsewhere."""
    for record in records:
        logger = logging.getLogger(record.name)
        if logger.isEnabledFor(record.levelno):
            logger.handle(record)
