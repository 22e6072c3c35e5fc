"""Corrections of logs that name robots and state units themselves: names, clock, unit of ranges, sense of azimuths."""

from __future__ import annotations

import logging
from dataclasses import replace
from decimal import Decimal

from wiclosure.formats.radio.radio_units import azimuth_rad, elevation_rad, metres
from wiclosure.pipeline.radio.readers.tag_names import TagNames
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.types import AoaPath, WirelessLog, WirelessMeasurement

logger = logging.getLogger(__name__)

CORRECTIONS = {
    "robots", "anchors", "time_offset", "unit", "max_range", "range_offset", "range_sigma", "clockwise",
    "azimuth_zero", "elevation_zero", "aoa_frame",
}  # fmt: skip
"""Settings that such logs can be corrected by."""


def corrected(log: WirelessLog, source: RadioSource, names: TagNames) -> WirelessLog:
    """The log, with what the source states laid over it; without anchors, in order of time again.

    Ranges keep their own sigma where the source states none: it is in metres whatever the unit of the ranges.
    """
    if not source.model_fields_set & CORRECTIONS:
        return log
    offset_ns = round(Decimal(str(source.time_offset)) * 10**9)
    measurements = tuple(
        _measurement(m, source, names, offset_ns)
        for m in log.measurements
        if not (names.is_anchor(m.receiver) or names.is_anchor(m.transmitter))
    )
    near = tuple(m for m in measurements if m.range_m is None or m.range_m <= source.max_range)
    if (far := len(measurements) - len(near)) and "max_range" in source.model_fields_set:
        logger.warning("%s: %d ranges lie beyond max_range and were left out", source.described(), far)
        measurements = near
    headings = tuple(
        replace(h, stamp_ns=h.stamp_ns + offset_ns, robot=names.robot(h.robot) or h.robot) for h in log.headings
    )
    return WirelessLog() + WirelessLog(measurements, headings)


def _measurement(m: WirelessMeasurement, source: RadioSource, names: TagNames, offset_ns: int) -> WirelessMeasurement:
    sent_ns, sigma = m.transmitter_stamp_ns, source.range_sigma
    return replace(
        m,
        stamp_ns=m.stamp_ns + offset_ns,
        transmitter_stamp_ns=None if sent_ns is None else sent_ns + offset_ns,
        receiver=names.robot(m.receiver) or m.receiver,
        transmitter=names.robot(m.transmitter) or m.transmitter,
        range_m=None if m.range_m is None else max(metres(m.range_m, source.unit) + source.range_offset, 0.0),
        range_sigma_m=sigma if m.range_m is not None and isinstance(sigma, float) else m.range_sigma_m,
        paths=tuple(_path(path, source) for path in m.paths),
        aoa_frame=source.aoa_frame if "aoa_frame" in source.model_fields_set else m.aoa_frame,
    )


def _path(path: AoaPath, source: RadioSource) -> AoaPath:
    azimuth = azimuth_rad(path.azimuth, "rad", source.azimuth_zero, clockwise=source.clockwise)
    elevation = path.elevation
    if elevation is not None:
        elevation = elevation_rad(elevation, "rad", source.elevation_zero)
    return replace(path, azimuth=azimuth, elevation=elevation)
