"""What drivers call the fields of a point; upper and lower case and underscores count as nothing."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

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
    "ptime",
    "trel",
    "lasertime",
    "delay",
    "tof",  # times of flight, as a rule: see `are_of_flight`
)
_UNITS = (
    "ns",
    "100ns",
    "10us",
    "100us",
    "nsec",
    "nanosec",
    "nanoseconds",
    "us",
    "usec",
    "ms",
    "msec",
    "s",
    "sec",
    "seconds",
)
_INTENSITIES = ("intensity", "i", "reflectivity", "reflectance", "remission", "intensities", "amplitude")
_AS_RANGES = 0.99  # correlation, with what few digits leave of it
_FEWEST = 20  # points; among fewer it may be chance
_LIKE_TIME = re.compile(r"time|stamp|latency|clock|secs?$|seconds?$|(^|_)(ts|tof|tick|ticks|t|dt|delay)(_|$)|offset")


def plain(name: str) -> str:
    """The name as it is compared."""
    return re.sub(r"[^a-z0-9]", "", name.lower())


def time_fields(names: Iterable[str]) -> list[str]:
    """The names of per-point times among these, the most usual first; a unit at the end (`time_ns`) is no matter."""
    found = {plain(name): name for name in names}
    order = [name + unit for name in _TIMES for unit in ("", *_UNITS)]
    return [found[name] for name in dict.fromkeys(order) if name in found]


def are_of_flight(name: str, times: NDArray[Any], x: NDArray[Any], y: NDArray[Any], z: NDArray[Any]) -> bool:
    """Whether the values `(N,)` of the field are times that light took and not those of points: they are as ranges."""
    if not plain(name).startswith("tof"):
        return False
    with np.errstate(invalid="ignore", over="ignore"):
        ranges = np.sqrt(x.astype(np.float64) ** 2 + y.astype(np.float64) ** 2 + z.astype(np.float64) ** 2)
    seen = np.isfinite(ranges) & (ranges > 0) & np.isfinite(times.astype(np.float64))
    if np.count_nonzero(seen) < _FEWEST or not np.ptp(times[seen]) or not np.ptp(ranges[seen]):
        return False
    return bool(np.corrcoef(ranges[seen], times[seen].astype(np.float64))[0, 1] > _AS_RANGES)


def intensity_field(names: Iterable[str]) -> str | None:
    """The name of the intensity among these, or None."""
    found = {plain(name): name for name in names}
    return next((found[name] for name in _INTENSITIES if name in found), None)


def like_times(names: Iterable[str], used: Sequence[str]) -> list[str]:
    """Names that look like times without being one of those `used`."""
    return [name for name in names if name not in used and _LIKE_TIME.search(name.lower())]
