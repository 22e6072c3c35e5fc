"""Inertial measurements and positions as tables of text, with a line of names or in the order that is told here."""

from __future__ import annotations

import logging
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.plausible import plausible_rows
from wiclosure.formats.radio.radio_units import TimeUnit, is_fraction, stamp_ns, time_unit_in
from wiclosure.formats.text_cells import number_of
from wiclosure.formats.text_table import TextTable, open_table
from wiclosure.pipeline.sources.navigation.gnss_topics import GNSS_BOUNDS, UNKNOWN_SIGMA_M
from wiclosure.pipeline.sources.navigation.imu_topics import FASTEST_RAD_S, STRONGEST_M_S2
from wiclosure.types import FloatArray, GnssLog, ImuLog, IntArray

logger = logging.getLogger(__name__)

_ACCELERATION = r"(a|acc|accel|accelerations?|linear_?acceleration)"
_RATE = r"(w|g|gyr|gyro|omega|rates?|turning_?rate|angular_?velocity|angular_?rate)"
IMU_BOUNDS = np.array([STRONGEST_M_S2] * 3 + [FASTEST_RAD_S] * 3)
_SIGMA = r"(sigma|std|sd|stddev)\b|(sigma|std|sd)_"
_STAMP = r"#?\s*(stamp|time|timestamp|ts?)(\b|_).*"
IMU_COLUMNS: Mapping[str, str] = {
    "stamp": _STAMP,
    **{f"acceleration {axis}": rf"{_ACCELERATION}([^a-z].*)?_?\.?{axis}\b.*" for axis in "xyz"},
    **{f"turning rate {axis}": rf"{_RATE}([^a-z].*)?_?\.?{axis}\b.*" for axis in "xyz"},
}
GNSS_COLUMNS: Mapping[str, str] = {
    "stamp": _STAMP,
    "latitude": r"lat(itude)?\b.*",
    "longitude": r"(lon|lng|long|longitude)\b.*",
    "height": r"(alt|altitude|height|h)\b.*",
}


def read_imu_table(path: Path) -> ImuLog:
    """Columns stamp, acceleration x y z, turning rate x y z: in this order where no line names them (EuRoC's does).

    Raises:
        InputError: it cannot be read, or columns are missing.
    """
    stamps_ns, values = _columns(path, IMU_COLUMNS)
    keep = plausible_rows(path, "samples", values[:, :6], IMU_BOUNDS, "expected m/s^2 and rad/s")
    stamps_ns, values = stamps_ns[keep], values[keep]
    return ImuLog(stamps_ns, values[:, :3], values[:, 3:6])


def read_gnss_table(path: Path) -> GnssLog:
    """Columns stamp, latitude, longitude (degrees), height (m), in this order where no line names them.

    Three further columns, named `sigma...` or `std...` where there is a line of names, are standard deviations east,
    north and up, m.

    Raises:
        InputError: it cannot be read, or columns are missing.
    """
    stamps_ns, values = _columns(path, GNSS_COLUMNS)
    keep = plausible_rows(path, "fixes", values[:, :3], GNSS_BOUNDS, "expected degrees, latitude first, and metres")
    stamps_ns, values = stamps_ns[keep], values[keep]
    stated = values[:, 3:6] if values.shape[1] >= 6 else np.tile(UNKNOWN_SIGMA_M, (len(values), 1))
    sigma = np.where(np.isfinite(stated) & (stated > 0), stated, UNKNOWN_SIGMA_M)
    return GnssLog(stamps_ns, values[:, :3], sigma)


def _columns(path: Path, wanted: Mapping[str, str]) -> tuple[IntArray, FloatArray]:
    """Stamps and the wanted columns in their order, in order of time; rows without numbers are left out and counted."""
    table = open_table(path)
    places = _places(path, table.columns, wanted) if table.has_header else list(range(len(table.columns)))
    if len(places) < len(wanted):
        raise InputError(
            f"{path} has {len(places)} columns; expected {len(wanted)}: {', '.join(wanted)}, or a line that names them"
        )
    unit = _stamp_unit(path, table, places[0])
    rows, stamps, bad = list[list[float]](), list[int](), 0
    for _, cells in table.rows():
        try:
            stamps.append(stamp_ns(cells[places[0]], unit))
            rows.append([number_of(cells[place]) for place in places[1:]])
        except (ValueError, IndexError):
            del stamps[len(rows) :]
            bad += 1
    values, stamps_ns = np.array(rows, float).reshape(len(rows), len(places) - 1), np.array(stamps, np.int64)
    finite = np.isfinite(values[:, : len(wanted) - 1]).all(axis=1)
    stamps_ns, first = np.unique(stamps_ns[finite], return_index=True)
    values = values[finite][first]
    if left_out := bad + len(rows) - len(values):
        logger.warning("%s: %d of %d rows hold no numbers or repeat a stamp; left out", path, left_out, len(rows) + bad)
    if not len(values):
        raise InputError(f"{path} holds no rows of {', '.join(wanted)}")
    return stamps_ns, values


def _stamp_unit(path: Path, table: TextTable, place: int) -> TimeUnit:
    """As the column's name or the line below it states; else by the size of each stamp."""
    if any(is_fraction(name) for n, name in enumerate(table.columns) if n != place):
        raise InputError(f"{path} has seconds and nanoseconds in two columns; write them as one number of seconds")
    below = table.units[place] if table.units else ""
    return time_unit_in(table.columns[place]) or time_unit_in(below) or "auto"


def _places(path: Path, names: Sequence[str], wanted: Mapping[str, str]) -> list[int]:
    """Where each wanted column is, by the line of names."""
    places = []
    for what, pattern in wanted.items():
        found = [n for n, name in enumerate(names) if re.fullmatch(pattern, name.strip().lower().replace(" ", "_", 0))]
        if not found:
            raise InputError(f"{path} has no column of {what}; its columns: {', '.join(names)}")
        places.append(found[0])
    return places + [n for n, name in enumerate(names) if re.match(_SIGMA, name.strip().lower()) and n not in places]
