"""OXTS files of KITTI's raw drives: inertial measurements and positions, one file for each instant."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from wiclosure import se3
from wiclosure.errors import InputError
from wiclosure.formats.plausible import require_rotation
from wiclosure.pipeline.sources.clouds.file_stamps import natural
from wiclosure.pipeline.sources.clouds.times_file import read_times
from wiclosure.pipeline.sources.navigation.imu_topics import ImuReading
from wiclosure.types import FloatArray, GnssLog, ImuLog, IntArray

_GEODETIC, _ACCELERATION, _RATE, _ACCURACY = slice(0, 3), slice(11, 14), slice(17, 20), 23
_CALIBRATION = "calib_imu_to_velo.txt"
_LEAST_SIGMA_M = 0.05
_HEIGHT_FACTOR = 2.0  # satellites are all above: heights err about twice as much


def oxts_folder(path: Path) -> Path | None:
    """The folder `oxts` of a raw drive, or one that holds `data` itself; None where there is neither."""
    return next((folder for folder in (path / "oxts", path) if _is_oxts(folder)), None)


def _is_oxts(folder: Path) -> bool:
    return (folder / "timestamps.txt").is_file() and next((folder / "data").glob("*.txt"), None) is not None


def read_oxts_imu(folder: Path) -> ImuReading:
    """Specific force and turning rates; with the mounting where the calibration lies beside the drive.

    Raises:
        InputError: files cannot be read or do not fit the times.
    """
    stamps_ns, rows = _rows(folder)
    files = (parent / _CALIBRATION for parent in folder.parents[:3])
    calibration = next((file for file in files if file.is_file()), None)
    T_lidar_imu = None if calibration is None else _transform(calibration)
    return ImuReading(ImuLog(stamps_ns, rows[:, _ACCELERATION], rows[:, _RATE]), "", T_lidar_imu)


def read_oxts_gnss(folder: Path) -> GnssLog:
    """Positions with the accuracy that the receiver states.

    Raises:
        InputError: files cannot be read or do not fit the times.
    """
    stamps_ns, rows = _rows(folder)
    across = np.maximum(rows[:, _ACCURACY], _LEAST_SIGMA_M)
    return GnssLog(stamps_ns, rows[:, _GEODETIC], np.stack([across, across, _HEIGHT_FACTOR * across], axis=1))


def _rows(folder: Path) -> tuple[IntArray, FloatArray]:
    files = sorted((folder / "data").glob("[!.]*.txt"), key=lambda file: natural(file.name))
    stamps_ns = read_times(folder / "timestamps.txt")
    if len(files) != len(stamps_ns):
        raise InputError(f"{folder} has {len(files)} files and {len(stamps_ns)} times; complete it")
    try:
        rows = np.array([file.read_text().split()[: _ACCURACY + 1] for file in files], float)
    except (OSError, ValueError) as error:
        raise InputError(f"{folder}/data does not hold OXTS files of 30 numbers ({error})") from error
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(stamps_ns)) > 0])
    return stamps_ns[keep], rows[keep]


def _transform(path: Path) -> FloatArray:
    """`T_lidar_imu (4, 4)` of `calib_imu_to_velo.txt`."""
    try:
        lines = dict(line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
        R, t = np.array(lines["R"].split(), float).reshape(3, 3), np.array(lines["T"].split(), float)
    except (OSError, KeyError, ValueError) as error:
        raise InputError(
            f"{path} does not hold R and T of an IMU ({error}); take it away to have them found"
        ) from error
    require_rotation(path, R)
    U, _, Vt = np.linalg.svd(R)
    return np.asarray(se3.from_rotation_translation(U @ Vt, t.reshape(3)))
