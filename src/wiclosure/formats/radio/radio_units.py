"""Units of lengths, times and angles in radio logs, and their conversion to metres, nanoseconds and radians."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from typing import Literal, TypeAlias

from wiclosure.formats.epochs import DOTNET, FILETIME, Epoch
from wiclosure.formats.plausible import LATEST_NS

LengthUnit: TypeAlias = Literal["m", "mm", "cm", "dm", "km", "ft", "in"]
TimeUnit: TypeAlias = Literal["auto", "s", "ms", "100us", "10us", "us", "100ns", "ns", "filetime", "dotnet"]
AngleUnit: TypeAlias = Literal["rad", "deg"]
AzimuthZero: TypeAlias = Literal["forward", "left", "back", "right"]
ElevationZero: TypeAlias = Literal["horizontal", "up"]

METRES: Mapping[LengthUnit, float] = {
    "m": 1.0,
    "mm": 1e-3,
    "cm": 1e-2,
    "dm": 1e-1,
    "km": 1e3,
    "ft": 0.3048,
    "in": 0.0254,
}
NANOSECONDS: Mapping[TimeUnit, int] = {
    "s": 10**9, "ms": 10**6, "100us": 10**5, "10us": 10**4, "us": 10**3, "100ns": 100, "ns": 1
}  # fmt: skip
_TICKS: Mapping[TimeUnit, Epoch] = {"filetime": FILETIME, "dotnet": DOTNET}
_TICK_NS = 100
_SI_UNITS: tuple[TimeUnit, ...] = ("s", "ms", "us", "ns")
_LONGEST_STEP_S = 10.0  # between poses or scans in whole seconds, typically
_LONGEST_STEP_OF_DATES_S = 900.0  # nanoseconds of 1 kHz, read as milliseconds, are farther apart
_UNITS_IN_CELLS: Mapping[str, TimeUnit] = {"s": "s", "sec": "s", "ms": "ms", "us": "us", "µs": "us", "ns": "ns"}
_UNIT_OF_NAME = re.compile(r"(?:^|[\[(_.\s])([^\W_]+)\s*[\])]?$")
_UNIT_WORDS: Mapping[str, TimeUnit] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "µs", "usec", "usecs", "micros", "microseconds"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanoseconds"), "ns"),
}
_FRACTION = re.compile(r"^ns$|(^|[^a-z])(n(ano)?secs?|nanoseconds)$")
_WITH_UNIT = re.compile(rf"([-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?)\s*({'|'.join(_UNITS_IN_CELLS)})")
_FROM_S, _TO_S = 946_684_800, 4_102_444_800  # 2000 to 2100: what a unit must make of a date, a tenth of another's
_ZERO_RAD: Mapping[AzimuthZero, float] = {
    "forward": 0.0,
    "left": math.pi / 2,
    "back": math.pi,
    "right": -math.pi / 2,
}


def metres(value: float, unit: LengthUnit) -> float:
    """A length; millimetres and the like divide by a whole number, so that 20534 mm is 20.534 m to the last digit."""
    factor = METRES[unit]
    return value / round(1 / factor) if unit in {"mm", "cm", "dm"} else value * factor


def date_unit_of(value: Decimal) -> TimeUnit | None:
    """The unit of a date since 1970, or the clock it is of, told by its size; None for what is no date."""
    size = abs(value)
    for clock, epoch in _TICKS.items():
        if _FROM_S * 10**9 <= size * _TICK_NS - epoch.before_1970_ns < _TO_S * 10**9:
            return clock
    for unit, nanoseconds in NANOSECONDS.items():
        if _FROM_S * 10**9 <= size * nanoseconds < _TO_S * 10**9:
            return unit
    return None


def stamp_unit_of(value: Decimal) -> TimeUnit:
    """As `date_unit_of`; times since a start-up are seconds, unless they are larger than any."""
    if (unit := date_unit_of(value)) is not None:
        return unit
    size = abs(value)
    if size >= 10**17:
        return "ns"
    if size >= 10**14:
        return "us"
    return "ms" if size >= 10**11 else "s"


def stamp_unit_of_path(stamps: Sequence[str]) -> TimeUnit:
    """The unit of the times of poses or scans in their order: by the size of the first, as `stamp_unit_of`.

    Whole numbers are of a finer unit where only then they follow each other as those of a path do: a thousand seconds
    since a start-up, in nanoseconds, look like a date of 2001 in milliseconds.
    """
    first = Decimal(stamps[0])
    by_size = stamp_unit_of(first)
    if by_size not in _SI_UNITS or len(stamps) < 2 or not all(stamp.isdecimal() for stamp in stamps):
        return by_size
    step = statistics.median(int(after) - int(before) for before, after in pairwise(stamps))
    seconds = {unit: step * NANOSECONDS[unit] / 10**9 for unit in _SI_UNITS[_SI_UNITS.index(by_size) :]}
    if date_unit_of(first) is not None and seconds[by_size] <= _LONGEST_STEP_OF_DATES_S:
        return by_size
    return next((unit for unit, step_s in seconds.items() if step_s < _LONGEST_STEP_S), by_size)


def time_unit_in(name: str) -> TimeUnit | None:
    """The unit that a column of times states in its name, as `stamp [ns]`, `time_us` or `seconds`; else None."""
    found = _UNIT_OF_NAME.search(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name.strip()).casefold())
    return None if found is None else _UNIT_WORDS.get(found[1])


def is_fraction(name: str) -> bool:
    """Whether a column may hold the nanoseconds of a second, as `header.stamp.nsecs`, by its name."""
    return _FRACTION.search(name.strip().casefold()) is not None


def stamp_ns(value: Decimal | str | float, unit: TimeUnit) -> int:
    """Exact nanoseconds of a time, or of a date and time as ISO 8601 writes them (UTC where no zone is named).

    A unit behind the number, as `1.5 s`, counts for it.

    Raises:
        ValueError: not a time, or too large for 64 bits.
    """
    try:
        number = value if isinstance(value, Decimal) else Decimal(str(value).strip())
    except InvalidOperation:
        if (found := unit_in_cell(str(value))) is not None:
            return stamp_ns(*found)
        return _date_ns(str(value))
    if not number.is_finite():
        raise ValueError(f"{value!r} is no time")
    if number.adjusted() > 19:
        raise ValueError(f"{str(value)[:40]!r} is no time: it lies beyond the year 2200")
    if number.adjusted() < -30:
        return 0
    unit = stamp_unit_of(number) if unit == "auto" else unit
    if unit in _TICKS:
        scaled = round(number * _TICK_NS) - _TICKS[unit].before_1970_ns
    else:
        scaled = round(number * NANOSECONDS[unit])
    if abs(scaled) > LATEST_NS:
        raise ValueError(f"{str(value)[:40]!r} is no time: it lies beyond the year 2200")
    return scaled


def unit_in_cell(text: str) -> tuple[Decimal, TimeUnit] | None:
    """Number and unit of a time that names its own, as `1.5 s`; None where it names none."""
    found = _WITH_UNIT.fullmatch(text.strip())
    return None if found is None else (Decimal(found[1]), _UNITS_IN_CELLS[found[2]])


def _date_ns(text: str) -> int:
    """`2024-05-01T10:00:00.123456789Z`; datetime keeps microseconds, so the fraction is read apart."""
    if re.fullmatch(r"\d{1,2}:\d\d(:\d\d([.,]\d*)?)?", text.strip()):
        raise ValueError(f"{text[:40]!r} is a time of day; name the column of the date too, as stamp: [date, time]")
    if ":" not in text:
        raise ValueError(f"{text[:40]!r} is no time")
    head, point, tail = text.strip().partition(".")
    digits = tail[: len(tail) - len(tail.lstrip("0123456789"))]
    try:
        moment = datetime.fromisoformat(head.replace("/", "-") + tail[len(digits) :])
    except ValueError:
        raise ValueError(f"{text[:40]!r} is no time; write dates as 2024-05-31T14:05:00.25") from None
    moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    whole_s = since.days * 86_400 + since.seconds
    fraction_ns = round(Decimal(f"0.{digits}") * 10**9) if point and digits else 0
    return whole_s * 10**9 + fraction_ns


def radians(value: float, unit: AngleUnit) -> float:
    """An angle."""
    return math.radians(value) if unit == "deg" else value


def azimuth_rad(value: float, unit: AngleUnit, zero: AzimuthZero, *, clockwise: bool) -> float:
    """Azimuth counter-clockwise from x forward, of one counted from another axis or the other way round."""
    angle = radians(value, unit)
    if zero == "forward" and not clockwise:
        return angle
    turned = (-angle if clockwise else angle) + _ZERO_RAD[zero]
    return math.remainder(turned, 2 * math.pi)


def elevation_rad(value: float, unit: AngleUnit, zero: ElevationZero) -> float:
    """Elevation up from the horizontal plane, of one counted from there or down from straight up."""
    angle = radians(value, unit)
    return math.pi / 2 - angle if zero == "up" else angle
