"""Writes inertial measurements and positions as the tables that are read by `sources.navigation.tables`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wiclosure.errors import OutputError
from wiclosure.formats.stamps import seconds_text
from wiclosure.types import FloatArray, GnssLog, ImuLog, IntArray


def write_imu_table(path: Path, log: ImuLog) -> None:
    """One sample a line, under a line of names.

    Raises:
        OutputError: the file cannot be written.
    """
    _write(path, "stamp,ax,ay,az,gx,gy,gz", log.stamps_ns, np.hstack([log.acceleration, log.turning_rate]))


def write_gnss_table(path: Path, log: GnssLog) -> None:
    """One fix a line, under a line of names.

    Raises:
        OutputError: the file cannot be written.
    """
    names = "stamp,latitude,longitude,height,sigma_east,sigma_north,sigma_up"
    _write(path, names, log.stamps_ns, np.hstack([log.geodetic, log.sigma_enu]))


def _write(path: Path, names: str, stamps_ns: IntArray, values: FloatArray) -> None:
    rows = zip(seconds_text(stamps_ns.tolist()), values.tolist(), strict=True)
    lines = [names, *(f"{stamp},{','.join(map(repr, row))}" for stamp, row in rows)]
    try:
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise OutputError(f"cannot write {path}: {error.strerror}; choose another folder") from error
