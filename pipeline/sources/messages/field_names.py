"""What drivers call the fields of a point; upper and lower case and underscores count as nothing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

_TIMES = (
    "t",  # Ouster, VBR, Boreas
    "time",  # Velodyne
    "offsettime",  # Livox
    "timeoffset",  # Aeva, converters of Livox
    "pointtimeoffset",  # Blickfeld
    "timestampoffset",
    "relativetime",
    "reltime",
    "relativetimestamp",
    "timestamp",  # Hesai, RoboSense, Livox
    "timestamps",
    "stamp",
    "stamps",
    "times",
    "ts",  # SICK
    "pointtime",
    "pointtimestamp",
    "latency",
    "dt",
    "deltat",
    "deltatime",
    "timediff",
    "gpstime",
    "utime",
)
_UNITS = ("ns", "nsec", "nanosec", "nanoseconds", "us", "usec", "ms", "msec", "s", "sec", "seconds")
_INTENSITIES = ("intensity", "i", "reflectivity", "reflectance", "remission", "intensities", "amplitude")
_LIKE_TIME = re.compile(r"time|stamp|latency|clock|secs?$|seconds?$|(^|_)(ts|tof|tick|ticks|t|dt)(_|$)|offset")


def plain(name: str) -> str:
    """The name as it is compared."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def time_fields(names: Iterable[str]) -> list[str]:
    """The names of per-point times among these, the most usual first; a unit at the end (`time_ns`) is no matter."""
    found = {plain(name): name for name in names}
    order = [name + unit for name in _TIMES for unit in ("", *_UNITS)]
    return [found[name] for name in dict.fromkeys(order) if name in found]


def intensity_field(names: Iterable[str]) -> str | None:
    """The name of the intensity among these, or None."""
    found = {plain(name): name for name in names}
    return next((found[name] for name in _INTENSITIES if name in found), None)


def like_times(names: Iterable[str], used: Sequence[str]) -> list[str]:
    """Names that look like times without being one of those `used`."""
    return [name for name in names if name not in used and _LIKE_TIME.search(name.lower())]
