"""Decimal seconds as exact integer nanoseconds, and back: nanoseconds since 1970 do not fit a float64."""

from __future__ import annotations

import re
from collections.abc import Iterable
from decimal import Decimal, InvalidOperation

import numpy as np
from numpy.typing import NDArray

from wiclosure.formats.plausible import LATEST_NS
from wiclosure.types import IntArray

_PLAIN = np.zeros(256, bool)
_PLAIN[[0, *b"0123456789."]] = True
_FEW_DIGITS = 7  # what C++ streams (6) and float32 (7) keep of a number


def nanoseconds(seconds: str) -> int:
    """Exact nanoseconds of one decimal number of seconds, rounded half to even beyond nine decimals.

    Raises:
        ValueError: not a finite number, or too large for 64 bits.
    """
    try:
        value = Decimal(seconds)
    except InvalidOperation:
        raise ValueError(f"{seconds[:40]!r} is not a number") from None
    if not value.is_finite():
        raise ValueError(f"{seconds!r} is not finite")
    if value.adjusted() > 18 or abs(value) * 10**9 > LATEST_NS:
        raise ValueError(f"{seconds[:40]!r} is too large for a time in seconds: it lies beyond the year 2200")
    return 0 if value.adjusted() < -18 else round(value.scaleb(9))


def few_digits(stamp: str) -> int | None:
    """How many digits a stamp kept, where it is so large that they are too few (`1.70000e+09`); else None.

    A whole second may end in zeros: ask where stamps repeat.
    """
    stamp = stamp.replace(",", ".")
    digits = re.sub(r"[eE].*|[^0-9]", "", stamp).strip("0")
    return len(digits) if len(digits) <= _FEW_DIGITS and abs(float(stamp)) >= 10**_FEW_DIGITS else None


def nanoseconds_of_column(seconds: NDArray[np.bytes_]) -> IntArray:
    """Exact nanoseconds `(N,)` of a column of decimal seconds, as bytes.

    Plain decimals (`12.300000000`) are parsed for all rows at once; exponents and signs row by row.

    Raises:
        ValueError: some row is not a finite number, or too large.
    """
    if not len(seconds):
        return np.zeros(0, np.int64)
    characters = np.ascontiguousarray(seconds).view(np.uint8).reshape(len(seconds), -1)
    whole, _, fraction = np.strings.partition(seconds, b".")
    if not _PLAIN[characters].all() or (np.strings.str_len(whole) == 0).any() or whole.dtype.itemsize == 0:
        return np.array([nanoseconds(row.decode()) for row in seconds], np.int64)
    if np.strings.str_len(whole).max() > 9 + 1:  # beyond the year 2286
        return np.array([nanoseconds(row.decode()) for row in seconds], np.int64)
    if (np.strings.find(fraction, b".") >= 0).any():
        raise ValueError("a number with two decimal points")
    ten_digits = np.strings.ljust(fraction.astype("S10"), 10, b"0").astype(np.int64)
    stamps_ns = whole.astype(np.int64) * 10**9 + (ten_digits + 5) // 10
    if stamps_ns.max() > LATEST_NS:
        raise ValueError(f"{seconds[int(np.argmax(stamps_ns))].decode()} lies beyond the year 2200")
    return np.asarray(stamps_ns)


def seconds_text(stamps_ns: Iterable[int]) -> list[str]:
    """Each stamp as decimal seconds with nine decimals; nothing is lost."""
    return [f"{'-' if ns < 0 else ''}{abs(ns) // 10**9}.{abs(ns) % 10**9:09d}" for ns in stamps_ns]
