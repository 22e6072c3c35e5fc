"""What clocks count from: not all from 1970."""

from __future__ import annotations

from typing import NamedTuple

_S = 10**9
_WEEK_S, _DAY_S = 604_800, 86_400
_GPS_BEGAN_S = 315_964_800  # 6 January 1980, since 1970
_LEAP_S = 18  # GPS does not count leap seconds; so many since 2017


class Epoch(NamedTuple):
    """A moment that times are counted from.

    Args:
        name: of such times, in words.
        before_1970_ns: how long before 1970 it was; negative after.
    """

    name: str
    before_1970_ns: int


UNIX = Epoch("since 1970", 0)
FILETIME = Epoch("since 1601 (Windows FILETIME)", 11_644_473_600 * _S)
DOTNET = Epoch("since the year 1 (.NET ticks)", 62_135_596_800 * _S)
_DATED = (
    FILETIME,
    DOTNET,
    Epoch("since 1900 (NTP)", 2_208_988_800 * _S),
    Epoch("since 1980 (GPS time)", (_LEAP_S - _GPS_BEGAN_S) * _S),
)


def epochs_at(stamp_ns: int) -> tuple[Epoch, ...]:
    """What a clock may count from that is read at a time since 1970, the usual first."""
    gps_s = stamp_ns // _S - _GPS_BEGAN_S + _LEAP_S
    week = Epoch("of the GPS week", (gps_s // _WEEK_S * -_WEEK_S - _GPS_BEGAN_S + _LEAP_S) * _S)
    day = Epoch("of the day (UTC)", stamp_ns // _S // _DAY_S * -_DAY_S * _S)
    return UNIX, *_DATED, week, day


def other_epoch(first_ns: int, last_ns: int, known_first_ns: int, known_last_ns: int) -> Epoch | None:
    """From what stamps seem to count, of which at least half lie within a known time then; None: no such epoch."""
    for epoch in epochs_at(known_first_ns)[1:]:
        begin, end = first_ns - epoch.before_1970_ns, last_ns - epoch.before_1970_ns
        shared_ns = min(end, known_last_ns) - max(begin, known_first_ns)
        if shared_ns >= 0 and 2 * shared_ns >= end - begin:
            return epoch
    return None
