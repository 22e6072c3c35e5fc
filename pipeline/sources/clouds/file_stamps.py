"""Stamps and order of clouds in single files, by their names."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import NamedTuple

import numpy as np

from wiclosure.formats.radio.radio_units import TimeUnit, stamp_ns, stamp_unit_of
from wiclosure.formats.stamps import nanoseconds
from wiclosure.types import IntArray

PERIOD_NS = 100_000_000  # 10 Hz, the usual rate of spinning LiDARs
_SMALLEST_DATE = 10**8
"""A whole number at least this large is a date, in a unit told by its size; a smaller one is a frame number."""


class FileStamps(NamedTuple):
    """Stamps `(N,)` in nanoseconds, how they were found in words, and whether they are made up."""

    stamps_ns: IntArray
    how: str
    made_up: bool = False


def natural(name: str) -> list[tuple[int, str]]:
    """Sorts names by the numbers in them: `_2` before `_10`."""
    return [(int(part) if part.isdecimal() else -1, part) for part in re.split(r"([0-9]+)", name)]


def stamps_of_names(names: Sequence[str]) -> FileStamps:
    """Stamps by file names without suffix, in natural order.

    Words before and after the numbers are no matter where all names share them.  `1317042272.123456789` and
    `1317042272_123456789` are seconds and their fraction; whole numbers of the size of a date are s, ms, us or ns since
    1970; smaller ones are frame numbers at 10 Hz.  `2023-11-14_22-13-20.5` is a date, UTC.  Other names are taken in
    natural order at 10 Hz.

    A fraction is not always written with all its zeros: `1317042272_5000000` may mean 0.005 s.  Of what it may mean
    (decimals, nanoseconds, microseconds, milliseconds), that is taken which puts the scans most evenly.
    """
    if (dated := _dates(names)) is not None:
        return dated
    parts = [re.split(r"([0-9]+)", name) for name in _with_fractions(names)]
    if len({tuple(part[0::2]) for part in parts}) == 1:
        words = parts[0][0::2]
        numbers = [[part[column] for part in parts] for column in range(1, len(parts[0]), 2)]
        return _by_numbers(words, numbers)
    return _counted(len(names), "natural order of their names")


_SECONDS = re.compile(
    r"(?P<before>.*?)(?P<seconds>(?<!\d)\d{9,10})(?:(?P<point>[._-])(?P<fraction>\d+))?(?P<after>\D*)"
)


def _with_fractions(names: Sequence[str]) -> Sequence[str]:
    """The names, `.0` put into those of whole seconds where others have a fraction: `%g` drops it."""
    found = [match for name in names if (match := _SECONDS.fullmatch(name)) is not None]
    points = {match["point"] for match in found} - {None}
    if len(found) < len(names) or len(points) != 1 or all(match["point"] for match in found):
        return names
    (point,) = points
    return [f"{m['before']}{m['seconds']}{point}{m['fraction'] or '0'}{m['after']}" for m in found]


_DATE = re.compile(
    r"(?<!\d)(?P<year>(?:19|20)\d\d)([-_.]?)(?P<month>0[1-9]|1[0-2])\2(?P<day>0[1-9]|[12]\d|3[01])[-_T ]?"
    r"(?P<hour>[01]\d|2[0-3])([-_.:]?)(?P<minute>[0-5]\d)\6(?P<second>[0-5]\d)(?:[-_.](?P<fraction>\d{1,9}))?(?!\d)"
)


def _dates(names: Sequence[str]) -> FileStamps | None:
    """By dates with their time, one in each name; None where some have none, or some have the same."""
    found = [match for name in names if (match := _DATE.search(name)) is not None]
    if not found or len(found) < len(names):
        return None
    texts = [
        f"{at['year']}-{at['month']}-{at['day']}T{at['hour']}:{at['minute']}:{at['second']}.{at['fraction'] or '0'}"
        for at in found
    ]
    try:
        stamps_ns = np.array([stamp_ns(text, "auto") for text in texts], np.int64)
    except ValueError:  # the 31st of February
        return None
    return FileStamps(stamps_ns, "file names, dates (UTC)") if len(set(stamps_ns.tolist())) == len(names) else None


def _by_numbers(words: Sequence[str], numbers: Sequence[Sequence[str]]) -> FileStamps:
    """By columns of numbers; `words` stand before, between and after them."""
    for column, texts in enumerate(numbers):
        follows = column + 1 < len(numbers) and words[column + 1] in {".", "_", "-"}
        if follows and (_unit(texts) == "s" or all(len(text) == 9 for text in numbers[column + 1])):
            return _seconds_and_fraction(texts, numbers[column + 1], decimal=words[column + 1] == ".")
    for texts in numbers:
        if (unit := _unit(texts)) is not None:
            how = f"file names, {unit}" + ("" if unit in {"filetime", "dotnet"} else " since 1970")
            return FileStamps(np.array([stamp_ns(text, unit) for text in texts], np.int64), how)
    if len(numbers) == 2 and list(words) == ["", ".", ""]:
        seconds = [f"{whole}.{fraction}" for whole, fraction in zip(*numbers, strict=True)]
        return FileStamps(np.array([nanoseconds(text) for text in seconds], np.int64), "file names, seconds")
    differing = [texts for texts in numbers if len(set(texts)) > 1] or list(numbers)
    if len(differing) == 1 and len(set(map(int, differing[0]))) == len(differing[0]):
        frames = np.array([int(text) for text in differing[0]], np.int64)
        return FileStamps(frames * PERIOD_NS, "frame numbers at 10 Hz", made_up=True)
    return _counted(len(numbers[0]) if numbers else 1, "natural order of their names")


def _seconds_and_fraction(seconds: Sequence[str], fractions: Sequence[str], *, decimal: bool) -> FileStamps:
    """By whole seconds and what follows them."""
    whole_ns = np.array([int(text) * 10**9 for text in seconds], np.int64)
    meanings: dict[str, Callable[[str], int]] = {
        "decimals": lambda text: int(text[:9].ljust(9, "0")),
        "nanoseconds": int,
        "microseconds": lambda text: int(text) * 10**3,
        "milliseconds": lambda text: int(text) * 10**6,
    }
    for how, digits in (("microseconds", 6), ("milliseconds", 3)):
        if max(map(len, fractions)) > digits:
            del meanings[how]
    if min(map(len, fractions)) == 9:
        del meanings["decimals"]
    read = {how: whole_ns + np.array([mean(text) for text in fractions], np.int64) for how, mean in meanings.items()}
    first = "decimals" if decimal else "nanoseconds"
    order = sorted(read, key=lambda how: (round(_unevenness(read[how]), 3), how != first))
    return FileStamps(read[order[0]], f"file names, seconds and {order[0]}")


def _unevenness(stamps_ns: IntArray) -> float:
    """The mean departure of the steps from the middle one, as a share of it; huge where stamps repeat."""
    steps = np.diff(np.sort(stamps_ns)).astype(float)
    if len(steps) == 0:
        return 0.0
    middle = float(np.median(steps))
    return float(np.abs(steps - middle).mean()) / middle if middle > 0 and steps.min() > 0 else 1e9


def _unit(texts: Sequence[str]) -> TimeUnit | None:
    """The unit of numbers of the size of a date."""
    smallest = min(map(int, texts))
    return stamp_unit_of(Decimal(smallest)) if smallest >= _SMALLEST_DATE else None


def _counted(count: int, how: str) -> FileStamps:
    return FileStamps(np.arange(count, dtype=np.int64) * PERIOD_NS, f"{how} at 10 Hz", made_up=True)
