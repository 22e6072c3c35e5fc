"""`sensor_msgs/NavSatFix` of a bag."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, cast

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.plausible import plausible_rows
from wiclosure.pipeline.sources.bags import open_bag
from wiclosure.pipeline.sources.messages.headers import HeaderMessage, nanoseconds_of, usual_fields
from wiclosure.pipeline.sources.stamps import Stamped, mended
from wiclosure.types import GnssLog

logger = logging.getLogger(__name__)

FIX_TYPE = "sensor_msgs/msg/NavSatFix"
UNKNOWN_SIGMA_M = (3.0, 3.0, 6.0)  # of a receiver that states none: open sky, no corrections

GNSS_BOUNDS = np.array([90.0, 360.0, 1e5])  # degrees and metres


class _Status(Protocol):
    status: int


class _Fix(Protocol):
    @property
    def header(self) -> HeaderMessage: ...

    status: _Status
    latitude: float
    longitude: float
    altitude: float
    position_covariance: Sequence[float]
    position_covariance_type: int


def read_fix_topic(path: Path, topic: str, *, salvage: bool = False) -> GnssLog:
    """All fixes of a topic; messages that say that there is none are left out and counted.

    Args:
        path: the bag.
        topic: its name.
        salvage: use what can be read of a damaged bag.

    Raises:
        InputError: no such topic, of another type, or without one fix.
    """
    with open_bag(path, salvage=salvage) as bag:
        name = bag.require_topic_of(FIX_TYPE, topic)
        messages = [(received_ns, cast("_Fix", message)) for received_ns, message in bag.messages(name)]
    place = f"{path}, topic {name}"
    with usual_fields(place):
        return _log(messages, place)


def _log(messages: list[tuple[int, _Fix]], place: str) -> GnssLog:
    """The fixes among messages, each with its time of reception."""
    fixes = [(received_ns, fix) for received_ns, fix in messages if fix.status.status >= 0 and _is_place(fix)]
    if not fixes:
        raise InputError(f"{place}: none of {len(messages)} messages holds a fix; leave the topic out")
    if len(fixes) < len(messages):
        logger.warning("%s: %d of %d messages hold no fix", place, len(messages) - len(fixes), len(messages))
    kept = list(mended((Stamped(nanoseconds_of(fix.header.stamp), ns, fix) for ns, fix in fixes), place))
    places = np.array([[fix.latitude, fix.longitude, fix.altitude] for _, fix in kept], float)
    keep = plausible_rows(place, "fixes", places, GNSS_BOUNDS, "expected degrees and metres; leave the topic out")
    stamps_ns, sigma = np.array([ns for ns, _ in kept], np.int64), np.array([_sigma(fix) for _, fix in kept], float)
    return GnssLog(stamps_ns[keep], places[keep], sigma[keep])


def _is_place(fix: _Fix) -> bool:
    numbers = (fix.latitude, fix.longitude, fix.altitude)
    return bool(np.isfinite(numbers).all()) and not (fix.latitude == 0.0 and fix.longitude == 0.0)


def _sigma(fix: _Fix) -> tuple[float, ...]:
    variance = np.array(fix.position_covariance, float).reshape(3, 3).diagonal()
    if fix.position_covariance_type == 0 or not np.isfinite(variance).all() or (variance <= 0).any():
        return UNKNOWN_SIGMA_M
    return tuple(np.sqrt(variance).tolist())
