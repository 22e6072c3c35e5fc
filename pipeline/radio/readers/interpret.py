"""From raw values to measurements: times, units, angles, ids."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from decimal import Decimal
from statistics import median
from typing import Any, cast

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.radio_units import (
    METRES,
    LengthUnit,
    azimuth_rad,
    elevation_rad,
    metres,
    radians,
    stamp_ns,
    stamp_unit_of,
)
from wiclosure.formats.stamps import few_digits
from wiclosure.formats.text_table import is_number, number_of
from wiclosure.formats.wireless_log import DEFAULT_RANGE_SIGMA_M
from wiclosure.pipeline.radio.readers.account import (
    ANCHOR,
    DEGREES,
    EMPTY,
    FAR,
    INVALID,
    LIMITS,
    REPEATED,
    SAME,
    UNKNOWN,
    UNREADABLE,
    Account,
)
from wiclosure.pipeline.radio.readers.rows import ReceivedAt, Row, Values
from wiclosure.pipeline.radio.readers.tag_names import TagNames, canonical, tag_text
from wiclosure.pipeline.radio.source import RadioSource
from wiclosure.types import AoaPath, WirelessLog, WirelessMeasurement

_MOST_BAD = 0.5  # of the rows: with more that cannot be read, the file is not what its mapping says
_SELDOM_M = 300.0  # of ranges whose unit nobody stated
_COARSE = 0.5  # of the rows: with more whose times lost their digits, and which share few, the log has no times
_MOST_BEYOND = 0.05  # of the rows: angles of radians stay within a turn, those of degrees seldom do
_FALSE = {"", "0", "0.0", "false", "no", "f", "n"}


_WITH_UNIT = re.compile(r"(?P<number>[-+.,\d]+(?:[eE][-+]?\d+)?)\s*(?P<unit>[a-z]+)")
_TURN_RAD = 2 * math.pi + 1e-6


class _LeftOut(Exception):  # noqa: N818  -- no error: a reading that is none
    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(detail)
        self.reason = reason


def interpret(
    rows: Iterable[Row], source: RadioSource, known: Collection[str] | None, where: str
) -> tuple[WirelessLog, Account]:
    """Measurements in order of time, each once, and what became of the rows.

    Args:
        rows: as read.
        source: what they mean.
        known: the robots that there are; None takes every name.
        where: the source, in messages.

    Raises:
        InputError: there are rows, but most cannot be read, or all lie beyond `max_range`; names the first.
    """
    account, names = Account(where), TagNames(source, known)
    for robot in (source.receiver, source.transmitter, *_mapped(source)):
        if robot is not None and known is not None and robot not in known:
            raise InputError(f"{where} names the robot {robot!r}, but there are {', '.join(known)}; name them alike")
    measurements: dict[WirelessMeasurement, str] = {}
    coarse: Counter[str] = Counter()
    for row in rows:
        account.rows += 1
        try:
            if row.problem is not None:
                raise _LeftOut(UNREADABLE, row.problem)
            measurement = _measurement(row.values, source, names, account)
        except _LeftOut as left:
            account.leave_out(left.reason, row.place, str(left))
        except (InputError, ValueError, TypeError) as error:
            account.leave_out(UNREADABLE, row.place, str(error))
        else:
            if measurement in measurements:
                account.leave_out(REPEATED, row.place, f"as {measurements[measurement]}")
            measurements.setdefault(measurement, row.place)
        if (text := str(row.values.get("stamp"))) and _is_coarse(text):
            coarse[text] += 1
    account.used = len(measurements)
    _refuse_lost_times(account, coarse)
    ranges_m = [m.range_m for m in measurements if m.range_m is not None]
    _refuse_nonsense(account, source, max(ranges_m, default=0.0))
    _doubt_unit(account, source, ranges_m)
    return WirelessLog() + WirelessLog(tuple(measurements)), account


def _mapped(source: RadioSource) -> Collection[str]:
    return source.robots.values() if isinstance(source.robots, dict) else ()


def _refuse_nonsense(account: Account, source: RadioSource, longest_m: float) -> None:
    bad = account.left_out[UNREADABLE]
    if bad and bad >= _MOST_BAD * account.rows:
        raise InputError(
            f"{account.where}: {bad} of {account.rows} rows cannot be read ({account.first[UNREADABLE]});"
            " check which field means what"
        )
    if account.left_out[DEGREES] > _MOST_BEYOND * account.rows:
        raise InputError(
            f"{account.where}: {account.left_out[DEGREES]} of {account.rows} rows have angles beyond a turn"
            f" ({account.first[DEGREES]}); they look like degrees: add angle_unit: deg"
        )
    near_limit = longest_m > source.max_range / 2  # a code for "nothing heard" stands apart from what was heard
    if account.left_out[FAR] > account.rows / 2 and (near_limit or not account.used):
        raise InputError(
            f"{account.where}: {account.left_out[FAR]} of {account.rows} ranges lie beyond {source.max_range:g} m"
            f" ({account.first[FAR]}); if they are millimetres or centimetres add unit: mm or unit: cm, else raise"
            " max_range"
        )


def _doubt_unit(account: Account, source: RadioSource, ranges_m: Sequence[float]) -> None:
    if ranges_m and "unit" not in source.model_fields_set and median(ranges_m) > _SELDOM_M:
        account.doubt(
            f"half of the ranges are longer than {median(ranges_m):.4g} m, which UWB does not reach; if they are"
            " centimetres add unit: cm, else state unit: m"
        )


def _is_coarse(stamp: str) -> bool:
    return is_number(stamp) and few_digits(stamp) is not None


def _refuse_lost_times(account: Account, coarse: Counter[str]) -> None:
    """Spreadsheets write `1.7E+09`: then many rows share one time."""
    if coarse.total() > _COARSE * account.rows and coarse.total() > 2 * len(coarse):
        text, count = coarse.most_common(1)[0]
        raise InputError(
            f"{account.where}: the time {text} stands in {count} of {account.rows} rows: whoever wrote it kept too few"
            " digits; export the log again with all of them"
        )


def _measurement(values: Values, source: RadioSource, names: TagNames, account: Account) -> WirelessMeasurement:
    if _is_false(values.get("valid", True)):
        raise _LeftOut(INVALID)
    receiver, transmitter = _robots(values, source, names, account)
    range_m, sigma_m = _range(values, source)
    path, reach_m = _bearing(values, source)
    if range_m is None and source.take != "bearing":
        range_m = reach_m
    if range_m is None and path is None:
        raise _LeftOut(EMPTY)
    if range_m is not None and range_m > source.max_range:
        raise _LeftOut(FAR, f"{range_m:g} m")
    arms = {canonical(tag): arm for tag, arm in source.lever_arms.items()}
    return WirelessMeasurement(
        stamp_ns=_stamp_ns(values, source, account),
        receiver=receiver,
        transmitter=transmitter,
        range_m=range_m,
        range_sigma_m=None if range_m is None else sigma_m,
        paths=() if path is None or source.take == "range" else (path,),
        aoa_frame=source.aoa_frame,
        lever_arm_receiver=arms.get(canonical(values.get("from", "")), (0.0, 0.0, 0.0)),
        lever_arm_transmitter=arms.get(canonical(values.get("to", "")), (0.0, 0.0, 0.0)),
    )


def _robots(values: Values, source: RadioSource, names: TagNames, account: Account) -> tuple[str, str]:
    robots: list[str] = []
    strangers: list[str] = []
    for key, given in (("from", source.receiver), ("to", source.transmitter)):
        tag = values.get(key)
        if given is not None:
            robots.append(given)
        elif tag is None or str(tag).strip() == "":
            role = "receiver" if key == "from" else "transmitter"
            raise _LeftOut(UNREADABLE, f"nothing says who the {role} is; name its field as {key}, or give {role}")
        elif (robot := names.robot(tag)) is not None:
            robots.append(robot)
        else:
            strangers.append(tag_text(tag))
    if strangers:
        unknown = [tag for tag in strangers if not names.is_anchor(tag)]
        account.ids.update(unknown)
        raise _LeftOut(UNKNOWN if unknown else ANCHOR)
    if robots[0] == robots[1]:
        raise _LeftOut(SAME)
    return robots[0], robots[1]


def _stamp_ns(values: Values, source: RadioSource, account: Account) -> int:
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
            account.note("stamps are read as dates, UTC where no zone is named")
    return stamp_ns(text, source.stamp_unit) + offset_ns


def _range(values: Values, source: RadioSource) -> tuple[float | None, float]:
    """Range and its sigma, metres; None where the cell is empty or holds what drivers write for a failure."""
    text, unit = _unit_of_cell(values.get("range"), source.unit)
    raw = _number(text, "range")
    if raw is None or raw <= 0:
        return None, _sigma_m(values, source)
    low, high = (_number(values.get(key), key) for key in ("range_low", "range_high"))
    if (low is not None and raw < low) or (high is not None and 0 < high < raw):
        raise _LeftOut(LIMITS, f"{raw:g}")
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


def _bearing(values: Values, source: RadioSource) -> tuple[AoaPath | None, float | None]:
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
    if source.angle_unit == "rad" and max(abs(azimuth), abs(elevation or 0.0)) > _TURN_RAD:
        raise _LeftOut(DEGREES, f"{max(azimuth, elevation or 0.0, key=abs):g}")
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


def _is_false(raw: object) -> bool:
    return str(raw).strip().casefold() in _FALSE
