"""Files of times, one a line for each scan."""

from __future__ import annotations

import logging
import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.radio.radio_units import TimeUnit, stamp_ns, stamp_unit_of, stamp_unit_of_path, time_unit_in
from wiclosure.formats.stamps import few_digits
from wiclosure.types import IntArray

logger = logging.getLogger(__name__)

_SAMPLE = 100
_COLUMNS = re.compile(r"[\s,;]+")
_NAME = re.compile(r"stamp|time", re.IGNORECASE)
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
        One a line, None for a blank one; without remarks, a line of names, and blank lines at the end.

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
    rows, names = _rows([line.strip() for line in lines])
    unit = _unit(path, names, [text for _, text in rows if text][:_SAMPLE])
    stamps = [_stamp(path, number, text, unit) if text else None for number, text in rows]
    while stamps and stamps[-1] is None:
        stamps.pop()
    _refuse_lost_digits(path, rows, stamps)
    _refuse_order(path, rows, stamps)
    return stamps


def _rows(lines: Sequence[str]) -> tuple[list[tuple[int, str]], str]:
    """Numbers and texts of the lines without remarks, of which blank ones count, and the line that names the times."""
    rows = [(number, line) for number, line in enumerate(lines, start=1) if not line.startswith("#")]
    names = [line.lstrip("# ") for line in lines if line.startswith("#") and _NAME.search(line)]
    first = next((row for row, (_, text) in enumerate(rows) if text), 0)
    if rows and _NAME.search(rows[first][1]) and not any(map(str.isdecimal, rows[first][1])):
        names.append(rows[first][1])
        rows = rows[first + 1 :]
    return _without_numbers(rows), names[-1] if names else ""


def _without_numbers(rows: Sequence[tuple[int, str]]) -> list[tuple[int, str]]:
    """Texts without the number of the scan, where each has it first (as TUM and EuRoC tools write)."""
    split = [(number, *(_COLUMNS.split(text, maxsplit=1) if text else ("", ""))) for number, text in rows]
    counted = [parts[1] for parts in split if parts[1]]
    if len(counted) > 1 and all(len(parts) == 3 for parts in split) and all(map(str.isdecimal, counted)):
        steps = {int(after) - int(before) for before, after in pairwise(counted)}
        if steps == {1}:
            return [(number, rest) for number, _, rest in split]
    return list(rows)


def _unit(path: Path, names: str, texts: Sequence[str]) -> TimeUnit:
    """As the line of names states; else `auto`, unless only another unit makes times of a drive of whole numbers."""
    if (stated := time_unit_in(names)) is not None:
        return stated
    if not texts or not all(map(str.isdecimal, texts)):
        return "auto"
    unit = stamp_unit_of_path(texts)
    if unit == stamp_unit_of(Decimal(texts[0])):
        return "auto"
    logger.warning("%s: its times are read as %s, by their steps", path, unit)
    return unit


def _stamp(path: Path, number: int, text: str, unit: TimeUnit) -> int:
    try:
        return stamp_ns(text, unit)
    except ValueError:
        raise InputError(f"{path}, line {number}: {text!r} is no time; expected seconds or a date with time") from None


def _refuse_lost_digits(path: Path, rows: Sequence[tuple[int, str]], stamps: Sequence[int | None]) -> None:
    """Times that all differ keep their digits, whatever they are."""
    seen: set[int] = set()
    for (number, text), stamp in zip(rows, stamps, strict=False):
        if stamp is not None and stamp in seen and _lost(text):
            raise InputError(
                f"{path}, line {number}: the time {text} stands there again: whoever wrote it kept too few"
                " digits; write times with nine decimals"
            )
        if stamp is not None:
            seen.add(stamp)


def _refuse_order(path: Path, rows: Sequence[tuple[int, str]], stamps: Sequence[int | None]) -> None:
    """Single times that repeat or go back cost their scans; where most do, they are no times of these scans."""
    known = [(stamp, row) for row, stamp in zip(rows, stamps, strict=False) if stamp is not None]
    wrong = [row for (before, _), (stamp, row) in pairwise(known) if stamp <= before]
    if 2 * len(wrong) > len(known):
        raise InputError(
            f"{path}, line {wrong[0][0]}: {wrong[0][1]} does not follow the time above it; so it is with"
            f" {len(wrong)} of {len(known)}; write times in the order of the scans"
        )


def _lost(text: str) -> bool:
    try:
        return Decimal(text).is_finite() and few_digits(text) is not None
    except InvalidOperation:
        return False
