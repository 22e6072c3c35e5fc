"""Inter-robot ranges from a CSV table, whatever its columns are called."""

from __future__ import annotations

import csv
import logging
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path

from wiclosure.errors import InputError
from wiclosure.types import WirelessLog, WirelessMeasurement

logger = logging.getLogger(__name__)

_STAMP_UNITS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_Arm = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RangeColumn:
    """One antenna pair's column.

    Args:
        range: name of the column of ranges, metres.
        sigma: name of the column of their standard deviations, or None.
        lever_arm_receiver, lever_arm_transmitter: antennas in the bodies' frames, metres.
    """

    range: str
    sigma: str | None = None
    lever_arm_receiver: _Arm = (0.0, 0.0, 0.0)
    lever_arm_transmitter: _Arm = (0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True)
class UwbColumns:
    """Which column means what.

    Args:
        stamp: name of the column of times.
        ranges: the columns of ranges, several where robots carry several antennas.
        stamp_unit: `s`, `ms`, `us` or `ns`.
        receiver, transmitter: columns that name the robots, or None where the file is about one pair.
        sigma_m: standard deviation of ranges that bring none (or 0).
    """

    stamp: str = "t"
    ranges: tuple[RangeColumn, ...] = field(default=(RangeColumn("range"),))
    stamp_unit: str = "s"
    receiver: str | None = None
    transmitter: str | None = None
    sigma_m: float = 0.2


def read_uwb_csv(
    path: Path | str, columns: UwbColumns, *, receiver: str | None = None, transmitter: str | None = None
) -> WirelessLog:
    """Ranges of a CSV file with a header line; empty and NaN cells are skipped and counted in one log line.

    Args:
        path: the file.
        columns: which column means what.
        receiver: the robot that ranged, where no column names it.
        transmitter: the robot that was ranged, likewise.

    Raises:
        InputError: the file cannot be read, a column is missing, or a value is not usable; names file and line.
    """
    if columns.stamp_unit not in _STAMP_UNITS:
        raise InputError(f"stamp unit {columns.stamp_unit!r}; expected one of {', '.join(_STAMP_UNITS)}")
    measurements: list[WirelessMeasurement] = []
    skipped = 0
    for line, row in _rows(Path(path), columns):
        try:
            for column in columns.ranges:
                range_m = _number(row, column.range)
                if math.isnan(range_m):
                    skipped += 1
                    continue
                sigma_m = math.nan if column.sigma is None else _number(row, column.sigma)
                measurements.append(
                    WirelessMeasurement(
                        stamp_ns=_stamp_ns(row, columns),
                        receiver=_robot(row, columns.receiver, receiver, "receiver"),
                        transmitter=_robot(row, columns.transmitter, transmitter, "transmitter"),
                        range_m=range_m,
                        range_sigma_m=columns.sigma_m if math.isnan(sigma_m) or sigma_m == 0 else sigma_m,
                        lever_arm_receiver=column.lever_arm_receiver,
                        lever_arm_transmitter=column.lever_arm_transmitter,
                    )
                )
        except InputError as error:
            raise InputError(f"{path}, line {line}: {error}") from error
    if skipped:
        logger.info("%s: %d empty ranges skipped", path, skipped)
    return WirelessLog() + WirelessLog(tuple(measurements))


def _rows(path: Path, columns: UwbColumns) -> Iterator[tuple[int, Mapping[str, str | None]]]:
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            table = csv.DictReader(file)
            header = set(table.fieldnames or ())
            needed = {columns.stamp, *(c.range for c in columns.ranges)}
            needed |= {c.sigma for c in columns.ranges if c.sigma is not None}
            needed |= {name for name in (columns.receiver, columns.transmitter) if name is not None}
            missing = sorted(needed - header)
            if missing:
                known = ", ".join(sorted(header)[:20]) or "none"
                raise InputError(f"{path} has no column {missing[0]!r}; map it to one of: {known}")
            for row in table:
                yield table.line_num, row
    except OSError as error:
        raise InputError(f"cannot read the ranges {path}: {error.strerror}; check the path") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} is not a CSV text file ({error}); expected a header line and rows") from error


def _number(row: Mapping[str, str | None], column: str) -> float:
    """The cell's number; NaN where it is empty."""
    text = (row[column] or "").strip()
    if not text:
        return math.nan
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"{column} is {text[:40]!r}; expected a number") from error


def _stamp_ns(row: Mapping[str, str | None], columns: UwbColumns) -> int:
    text = (row[columns.stamp] or "").strip()
    try:
        stamp = Decimal(text)
        if not abs(stamp) < Decimal(2**63) / _STAMP_UNITS[columns.stamp_unit]:
            raise InputError(f"{columns.stamp} is {text[:40]!r}; it does not fit 64 bits of nanoseconds")
        return round(stamp * _STAMP_UNITS[columns.stamp_unit])
    except ArithmeticError as error:
        raise InputError(f"{columns.stamp} is {text[:40]!r}; expected a time in {columns.stamp_unit}") from error


def _robot(row: Mapping[str, str | None], column: str | None, given: str | None, role: str) -> str:
    name = given if column is None else (row[column] or "").strip()
    if not name:
        raise InputError(f"no {role} is named; map a column to it or give its name")
    return name
