"""Times, ranges and bearings of one row of a radio log, in nanoseconds, metres and radians."""

from __future__ import annotations

import math
import re
from decimal import Decimal
from typing import Any, cast

import numpy as np

from wiclosure.formats.radio.radio_units import (
    METRES,
    LengthUnit,
    azimuth_rad,
    elevation_rad,
    metres,
    radians,
    stamp_ns,
    stamp_unit_of,
    unit_in_cell,
)
from wiclosure.formats.radio.wireless_log import DEFAULT_RANGE_SIGMA_M
from wiclosure.formats.text_cells import is_number, number_of
from wiclosure.pipeline.radio.readers.account import DEGREES, LIMITS, Account
from wiclosure.pipeline.radio.readers.rows import ReceivedAt, Values
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.types import TURN_RAD, AoaPath

_WITH_UNIT = re.compile(r"(?P<number>[-+.,\d]+(?:[eE][-+]?\d+)?)\s*(?P<unit>[a-z]+)")


class LeftOut(Exception):  # noqa: N818  -- no error
    """A reading that is none."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(detail)
        self.reason = reason


def measured_at_ns(values: Values, source: RadioSource, account: Account) -> int:
    """The time of a row.

    Raises:
        ValueError: it has none.
    """
    raw = values.get("stamp")
    offset_ns = round(Decimal(str(source.time_offset)) * 10**9)
    if isinstance(raw, ReceivedAt):
        return raw.stamp_ns + offset_ns
    if isinstance(raw, tuple) and not is_number(str(raw[0]).strip()):
        return stamp_ns("T".join(str(part).strip() for part in raw), "auto") + offset_ns
    if isinstance(raw, tuple):
        seconds, nanoseconds = (int(number_of(str(part))) for part in raw)
        return seconds * 10**9 + nanoseconds + offset_ns
    if raw is None or str(raw).strip() == "":
        raise ValueError("no time")
    text = str(raw).strip()
    if source.stamp_unit == "auto":
        try:
            unit = stamp_unit_of(Decimal(text))
            account.note(f"stamps are read as {unit}; state stamp_unit where that is wrong")
        except ArithmeticError:
            named = unit_in_cell(text)
            read_as = "their own unit says" if named else "dates, UTC where no zone is named"
            account.note(f"stamps are read as {read_as}")
    return stamp_ns(text, source.stamp_unit) + offset_ns


def range_of(values: Values, source: RadioSource) -> tuple[float | None, float]:
    """Range and its sigma, metres; None where the cell is empty or holds what drivers write for a failure."""
    text, unit = _unit_of_cell(values.get("range"), source.unit)
    raw = _number(text, "range")
    if raw is None or raw <= 0:
        return None, _sigma_m(values, source)
    low, high = (_number(values.get(key), key) for key in ("range_low", "range_high"))
    if (low is not None and raw < low) or (high is not None and 0 < high < raw):
        raise LeftOut(LIMITS, f"{raw:g}")
    return max(metres(raw, unit) + source.range_offset, 0.0), _sigma_m(values, source)


def _unit_of_cell(cell: object, usual: LengthUnit) -> tuple[object, LengthUnit]:
    """A cell without the unit that it states, as `3.25 m` and `3250mm`, and the unit."""
    match = _WITH_UNIT.fullmatch(cell.strip()) if isinstance(cell, str) else None
    if match is None or match["unit"] not in METRES:
        return cell, usual
    return match["number"], cast("LengthUnit", match["unit"])


def _sigma_m(values: Values, source: RadioSource) -> float:
    if isinstance(source.range_sigma, float):
        return source.range_sigma
    sigma = _number(values.get("range_sigma"), "range_sigma")
    variance = _number(values.get("range_variance"), "range_variance")
    if sigma is not None and sigma < 0:
        raise ValueError(f"range_sigma is {sigma:g}; it must be > 0")
    if sigma is None and variance is not None and variance > 0:
        sigma = math.sqrt(variance)
    return metres(sigma, source.unit) if sigma else DEFAULT_RANGE_SIGMA_M


def bearing_of(values: Values, source: RadioSource) -> tuple[AoaPath | None, float | None]:
    """Direction of the other, and its distance where a position says both."""
    sigma = source.bearing_sigma
    if not isinstance(sigma, float):
        found = _number(values.get("bearing_sigma"), "bearing_sigma")
        sigma = 0.1745 if not found else radians(found, source.angle_unit)
    position = [_number(values.get(axis), axis) for axis in "xyz"]
    if position[0] is not None and position[1] is not None:
        x, y, z = (metres(value or 0.0, source.unit) for value in position)
        reach_m = math.hypot(x, y, z)
        if reach_m == 0:
            return None, None
        elevation = None if position[2] is None else math.atan2(z, math.hypot(x, y))
        return AoaPath(math.atan2(y, x), sigma, elevation=elevation), max(reach_m + source.range_offset, 0.0)
    azimuth = _number(values.get("azimuth"), "azimuth")
    if azimuth is None:
        return None, None
    elevation = _number(values.get("elevation"), "elevation")
    if source.angle_unit == "rad" and max(abs(azimuth), abs(elevation or 0.0)) > TURN_RAD:
        raise LeftOut(DEGREES, f"{max(azimuth, elevation or 0.0, key=abs):g}")
    return AoaPath(
        azimuth_rad(azimuth, source.angle_unit, source.azimuth_zero, clockwise=source.clockwise),
        sigma,
        elevation=None if elevation is None else elevation_rad(elevation, source.angle_unit, source.elevation_zero),
    ), None


def _number(raw: Any, key: str) -> float | None:
    """A finite number; None where there is none."""
    if raw is None:
        return None
    if isinstance(raw, str):
        if not raw.strip() or raw.strip().casefold() in {"na", "none", "null", "-"}:
            return None
        try:
            value = number_of(raw.strip())
        except ValueError as error:
            raise ValueError(f"{key} is {raw.strip()[:40]!r}; expected a number") from error
    elif isinstance(raw, int | float | np.number | np.bool_):
        value = float(raw)
    else:
        raise TypeError(f"{key} is {str(raw)[:40]!r}; expected a number")
    return value if math.isfinite(value) else None
