"""Wireless logs, read: JSON Lines, one measurement or heading a line.

```
{"type":"wireless","stamp":12.300,"receiver":"alpha","transmitter":"beta","range":23.41,"range_sigma":0.5,
 "aoa_frame":"body","paths":[{"azimuth":0.31,"elevation":null,"sigma":0.1745,"weight":0.62}]}
{"type":"heading","stamp":12.300,"robot":"alpha","heading":1.57,"sigma":0.05}
```
(each record on one line).  Stamps are seconds; they are read as decimals, so that nanoseconds since 1970 stay exact.
Angles are radians, azimuth counter-clockwise from x forward, elevation up from the horizontal plane.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from wiclosure.errors import InputError
from wiclosure.formats.json_values import Record, name, number, optional, shown, vector
from wiclosure.formats.plausible import LATEST_NS, few
from wiclosure.formats.radio.radio_units import AngleUnit, radians
from wiclosure.formats.structured_text import parse_json
from wiclosure.suggestions import did_you_mean
from wiclosure.types import TURN_RAD, AoaPath, Heading, RangeError, WirelessLog, WirelessMeasurement

logger = logging.getLogger(__name__)

DEFAULT_RANGE_SIGMA_M = 0.5  # of a range without `range_sigma`: UWB between moving robots


def read_wireless_log(path: Path | str, *, angle_unit: AngleUnit = "rad") -> WirelessLog:
    """Reads a wireless log; records may stand in any order, the result is in order of time.

    Angles that look like degrees are not an error: one warning a file names the first line and how many there are.

    Args:
        path: the file.
        angle_unit: of its angles and their sigmas; logs of others may be in degrees.

    Raises:
        InputError: the file cannot be read, or a line is not a valid record; names the file and the line.
    """
    measurements: list[WirelessMeasurement] = []
    headings: list[Heading] = []
    degrees, odd = _Degrees(), list[str]()
    for line_number, line in _lines(Path(path)):
        try:
            record = _parsed(line) if angle_unit == "rad" else _in_radians(_parsed(line), angle_unit)
            if record["type"] == "heading":
                headings.append(_heading(record))
                degrees.check(line_number, [headings[-1].heading])
            else:
                measurements.append(_measurement(record))
                degrees.check(line_number, _angles(record))
        except RangeError as error:
            odd.append(f"line {line_number}: {error}")
        except InputError as error:
            raise InputError(f"{path}, line {line_number}: {error}") from error
    degrees.warn(path)
    if odd:
        _leave_out(path, odd, len(measurements) + len(headings) + len(odd))
    return WirelessLog() + WirelessLog(tuple(measurements), tuple(headings))


def _leave_out(path: Path | str, odd: Sequence[str], total: int) -> None:
    """Says what is left out because of numbers that nothing real has; raises InputError where that is more than few."""
    if not few(len(odd), total):
        raise InputError(f"{path}, {odd[0]}; so it is with {len(odd)} of {total} records")
    logger.warning("%s, %s; %d of %d records are left out for such numbers", path, odd[0], len(odd), total)


def _lines(path: Path) -> Iterator[tuple[int, bytes]]:
    """Line numbers from 1, and the lines that are not blank."""
    try:
        with path.open("rb") as file:
            for number, line in enumerate(file, start=1):
                if line.strip():
                    yield number, line
    except OSError as error:
        raise InputError(f"cannot read the wireless log {path}: {error.strerror}; check the path") from error


def _parsed(line: bytes) -> Record:
    """The JSON object of a line, decimals kept exact, its keys checked."""
    try:
        record = parse_json(line, exact=True)
    except InputError as error:
        raise InputError(f"{error}; write one complete JSON object a line, in UTF-8") from error
    if not isinstance(record, dict):
        raise InputError("not a JSON object; write one record {...} a line")
    kind = record.get("type")
    if not isinstance(kind, str) or kind not in _KEYS:
        raise InputError(f'"type" is {shown(kind)}; expected "wireless" or "heading"')
    _check_keys(record, kind)
    return record


_KEYS: Mapping[str, tuple[frozenset[str], frozenset[str]]] = {  # required, optional
    "wireless": (
        frozenset({"type", "stamp", "receiver", "transmitter"}),
        frozenset(
            {"range", "range_sigma", "aoa_frame", "paths", "transmitter_stamp"}
            | {"lever_arm_receiver", "lever_arm_transmitter"}
        ),
    ),
    "heading": (frozenset({"type", "stamp", "robot", "heading", "sigma"}), frozenset()),
    "path": (frozenset({"azimuth", "sigma"}), frozenset({"weight", "elevation"})),
}


def _check_keys(record: Record, kind: str) -> None:
    required, optional = _KEYS[kind]
    if required <= record.keys() <= required | optional:
        return
    missing = sorted(required - record.keys())
    if missing:
        raise InputError(f'{kind} record without "{missing[0]}"; add it')
    unknown = sorted(record.keys() - required - optional)
    if unknown:
        known = sorted(required | optional)
        hint = did_you_mean(unknown[0], known) or f"known keys: {', '.join(known)}"
        raise InputError(f"{kind} record with unknown key {shown(unknown[0])}; {hint.strip()}")


def _measurement(record: Record) -> WirelessMeasurement:
    range_m = optional(record, "range", number)
    range_sigma_m = optional(record, "range_sigma", number)
    if range_m is None:
        range_sigma_m = None
    elif range_sigma_m is None:
        range_sigma_m = DEFAULT_RANGE_SIGMA_M
    return WirelessMeasurement(
        stamp_ns=_stamp_ns(record, "stamp"),
        receiver=name(record, "receiver"),
        transmitter=name(record, "transmitter"),
        range_m=range_m,
        range_sigma_m=range_sigma_m,
        paths=optional(record, "paths", _paths) or (),
        aoa_frame=optional(record, "aoa_frame", name) or "body",  # type: ignore[arg-type]  # checked by the dataclass
        transmitter_stamp_ns=optional(record, "transmitter_stamp", _stamp_ns),
        lever_arm_receiver=optional(record, "lever_arm_receiver", vector) or (0.0, 0.0, 0.0),
        lever_arm_transmitter=optional(record, "lever_arm_transmitter", vector) or (0.0, 0.0, 0.0),
    )


def _heading(record: Record) -> Heading:
    return Heading(
        stamp_ns=_stamp_ns(record, "stamp"),
        robot=name(record, "robot"),
        heading=number(record, "heading"),
        sigma=number(record, "sigma"),
    )


def _paths(record: Record, key: str) -> tuple[AoaPath, ...]:
    entries = record[key]
    if not isinstance(entries, list):
        raise InputError(f'"{key}" is {shown(entries)}; expected a list of paths, or null')
    return tuple(_path(entry) for entry in entries)


def _path(entry: object) -> AoaPath:
    if not isinstance(entry, dict):
        raise InputError(f'a path is {shown(entry)}; expected {{"azimuth":..., "sigma":...}}')
    _check_keys(entry, "path")
    weight = optional(entry, "weight", number)
    azimuth, elevation = number(entry, "azimuth"), optional(entry, "elevation", number)
    if elevation is not None and abs(elevation) > math.pi / 2:
        raise InputError(
            f'"elevation" is {shown(entry["elevation"])}; expected radians within -pi/2 and pi/2: for a log in degrees'
            " add angle_unit: deg"
        )
    if abs(azimuth) > TURN_RAD:  # warned of, not refused: it may be radians over several turns
        azimuth = math.remainder(azimuth, 2 * math.pi)
    return AoaPath(
        azimuth=azimuth,
        sigma=number(entry, "sigma"),
        weight=1.0 if weight is None else weight,
        elevation=elevation,
    )


def _in_radians(record: Record, unit: AngleUnit) -> Record:
    """The record with all angles and their sigmas converted; what is no number stays for those who read it."""

    def converted(entry: object, keys: Sequence[str]) -> object:
        if not isinstance(entry, dict):
            return entry
        angles = {key: radians(number(entry, key), unit) for key in keys if entry.get(key) is not None}
        return {**entry, **angles}

    if record["type"] == "heading":
        return {**record, **{key: radians(number(record, key), unit) for key in ("heading", "sigma")}}
    paths = record.get("paths")
    if not isinstance(paths, list):
        return record
    return {**record, "paths": [converted(path, ("azimuth", "elevation", "sigma")) for path in paths]}


def _stamp_ns(record: Record, key: str) -> int:
    seconds = number(record, key)
    if abs(seconds) * 1e9 > LATEST_NS:
        raise InputError(
            f'"{key}" is {shown(record[key])}; stamps are seconds, not nanoseconds, and end with the year 2200'
        )
    return round(Decimal(record[key]) * 1_000_000_000)


@dataclass
class _Degrees:
    """Remembers the lines whose angles cannot be radians by the look of them."""

    first_line: int = 0
    example: float = 0.0
    lines: int = 0

    def check(self, line_number: int, angles: Iterable[float]) -> None:
        largest = max(angles, key=abs, default=0.0)
        if abs(largest) > TURN_RAD:
            self.lines += 1
            if self.lines == 1:
                self.first_line, self.example = line_number, largest

    def warn(self, path: Path | str) -> None:
        if self.lines:
            logger.warning(
                "%s, line %d: angle %g looks like degrees (%d lines do); angles are radians: add angle_unit: deg",
                path,
                self.first_line,
                self.example,
                self.lines,
            )


def _angles(record: Record) -> Iterator[float]:
    """Azimuths and sigmas as they stand in a measurement's record."""
    for path in record.get("paths") or ():
        yield float(path["azimuth"])
        yield float(path["sigma"])
