"""Files of times, one a line for each scan."""

from __future__ import annotations

import logging
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.stamps import nanoseconds
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
    """Stamps in nanoseconds, from seconds, nanoseconds since 1970, or dates (`2011-09-26 13:02:25.594360375`).

    Returns:
        One a line, None for a blank one; without blank lines at the end.

    Raises:
        InputError: the file is missing or a line is neither.
    """
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
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
    return stamps


_LARGEST_SECONDS = 10**11  # a larger whole number counts nanoseconds


def _stamp(path: Path, number: int, text: str) -> int:
    try:
        if "-" in text[1:] and ":" in text:
            return int(np.datetime64(text.replace(" ", "T"), "ns").astype(np.int64))
        if text.isdecimal() and int(text) > _LARGEST_SECONDS:
            return int(text)
        return nanoseconds(text)
    except ValueError:
        raise InputError(f"{path}, line {number}: {text!r} is no time; expected seconds or a date with time") from None
