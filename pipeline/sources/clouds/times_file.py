"""Files of times, one a line for each scan."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.radio.radio_units import stamp_ns
from wiclosure.formats.stamps import few_digits
from wiclosure.types import IntArray

logger = logging.getLogger(__name__)

_NAMES = ("times.txt", "timestamps.txt", "timestamp.txt")


def times_beside(folder: Path, count: int) -> tuple[IntArray, Path] | None:
    """Stamps `(N,)` in nanoseconds of so many clouds in a folder, and their file in it or beside it; None without one.

    A file beside the folder may belong to something else: one that does not fit is named and left alone.

    Raises:
        InputError: a file in the folder is no file of times.
    """
    for place in (folder, folder.parent):
        for path in (place / name for name in _NAMES if (place / name).is_file()):
            try:
                stamps_ns = read_times(path)
            except InputError as error:
                if place == folder:
                    raise
                logger.warning("%s; it is not used for the clouds in %s", error, folder)
                continue
            if len(stamps_ns) == count:
                return stamps_ns, path
            logger.warning(
                "%s has %d times for the %d clouds in %s and is not used; complete it, or take it away",
                path, len(stamps_ns), count, folder,
            )  # fmt: skip
    return None


def read_times(path: Path) -> IntArray:
    """Stamps `(N,)` in nanoseconds of all lines that are not blank; see `read_lines`."""
    return np.array([stamp for stamp in read_lines(path) if stamp is not None], np.int64)


def read_lines(path: Path) -> list[int | None]:
    """Stamps in nanoseconds, from seconds, dates (`2011-09-26 13:02:25.594360375`), or ms, us or ns since 1970.

    Returns:
        One a line, None for a blank one; without blank lines at the end.

    Raises:
        InputError: the file is missing, a line is neither, or times repeat that were written with too few digits.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except OSError as error:
        raise InputError(
            f"cannot read {path}: {error.strerror}; a KITTI folder needs it (one time in seconds for each scan)."
            " To take 10 scans a second instead, name the folder of the .bin files"
        ) from error
    except UnicodeDecodeError:
        raise InputError(f"{path} is not text; expected one time in seconds for each scan") from None
    stamps = [
        _stamp(path, number, line.strip()) if line.strip() and not line.lstrip().startswith("#") else None
        for number, line in enumerate(lines, start=1)
    ]
    while stamps and stamps[-1] is None:
        stamps.pop()
    _refuse_lost_digits(path, lines, stamps)
    return stamps


def _stamp(path: Path, number: int, text: str) -> int:
    try:
        return stamp_ns(text, "auto")
    except ValueError:
        raise InputError(f"{path}, line {number}: {text!r} is no time; expected seconds or a date with time") from None


def _refuse_lost_digits(path: Path, lines: Sequence[str], stamps: Sequence[int | None]) -> None:
    """Times that all differ keep their digits, whatever they are."""
    seen: set[int] = set()
    for number, (line, stamp) in enumerate(zip(lines, stamps, strict=False), start=1):
        if stamp is not None and stamp in seen and _lost(line.strip()):
            raise InputError(
                f"{path}, line {number}: the time {line.strip()} stands there again: whoever wrote it kept too few"
                " digits; write times with nine decimals"
            )
        if stamp is not None:
            seen.add(stamp)


def _lost(text: str) -> bool:
    try:
        return Decimal(text).is_finite() and few_digits(text) is not None
    except InvalidOperation:
        return False
