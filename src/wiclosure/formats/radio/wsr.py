"""WiFi angle-of-arrival output of the WSR-Toolbox: result files (JSON) and profile matrices (CSV).

Angles are degrees in the receiver's odometry (displacement) axes; elevation is polar, 90 degrees being horizontal, and
says nothing in runs of planar displacement.  The files carry no time: the caller gives each trial its stamp.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wiclosure.errors import InputError
from wiclosure.formats.structured_text import read_json
from wiclosure.types import AoaPath, FloatArray, WirelessLog, WirelessMeasurement

_LARGEST_RAD = 4 * math.pi


@dataclass(frozen=True, slots=True)
class AoaNoise:
    """How far a peak of a profile may be off, by the profile's variance; defaults fitted on 588 real profiles.

    `python -m wiclosure.wiclosure_filter.links.noise_model FILES...` repeats the fit.

    Args:
        log_sigma: log of sigma in radians, as `(offset, slope)` over the profile's variance.
        logit_absent: logit of the probability that no peak is the direct path, likewise.
        rank_ratio: how likely each next weaker peak is the direct path, relative to the one before; in the data that
            is 1: where there are several peaks, their order says nothing.
    """

    log_sigma: tuple[float, float] = (-2.494, 0.865)
    logit_absent: tuple[float, float] = (-17.68, 18.47)
    rank_ratio: float = 1.0

    def sigma_rad(self, variance: float | FloatArray) -> FloatArray:
        """Standard deviation of the direct path's azimuth; at least half a degree, at most a quarter turn."""
        return np.clip(np.exp(self.log_sigma[0] + self.log_sigma[1] * np.asarray(variance)), 0.01, np.pi / 2)

    def absent(self, variance: float | FloatArray) -> FloatArray:
        """Probability that the direct path is not among the peaks."""
        return np.asarray(1 / (1 + np.exp(-(self.logit_absent[0] + self.logit_absent[1] * np.asarray(variance)))))


@dataclass(frozen=True, slots=True, eq=False)
class WsrProfile:
    """One profile: the peaks of one receiver's view of one transmitter.

    Args:
        trial: key of the trial in the file.
        receiver: id of the receiving robot, as text.
        transmitter: name of the transmitting robot.
        variance: the toolbox's spread of the profile, about 0.5 (sharp) to 1.1 (flat).
        azimuth: `(N,)` rad, strongest peak first.
        elevation: `(N,)` rad up from horizontal, or None after planar displacement.
        true_azimuth: rad by motion capture, NaN where unknown.
    """

    trial: str
    receiver: str
    transmitter: str
    variance: float
    azimuth: FloatArray
    elevation: FloatArray | None
    true_azimuth: float

    def paths(self, noise: AoaNoise) -> tuple[AoaPath, ...]:
        """The peaks as paths of a wireless measurement."""
        sigma = float(noise.sigma_rad(self.variance))
        return tuple(
            AoaPath(
                azimuth=float(azimuth),
                sigma=sigma,
                weight=noise.rank_ratio**rank,
                elevation=None if self.elevation is None else float(self.elevation[rank]),
            )
            for rank, azimuth in enumerate(self.azimuth)
        )


def read_wsr_profiles(path: Path | str) -> tuple[WsrProfile, ...]:
    """All profiles of a WSR result file, in the order of the file.

    Raises:
        InputError: the file cannot be read or is not a WSR result; names the file and the trial.
    """
    try:
        trials = read_json(Path(path))
    except InputError as error:
        raise InputError(f"{error}; expected a WSR-Toolbox result") from error
    if not isinstance(trials, dict):
        raise InputError(f"{path} is not a WSR-Toolbox result: expected an object of trials")
    profiles: list[WsrProfile] = []
    for trial, records in trials.items():
        try:
            profiles += [_profile(trial, record) for record in records]
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise InputError(
                f"{path}, trial {trial!r}: {type(error).__name__} ({error}); expected a WSR-Toolbox record"
            ) from error
    return tuple(profiles)


def wsr_wireless_log(
    profiles: Sequence[WsrProfile],
    stamps_ns: Mapping[str, int],
    names: Mapping[str, str] | None = None,
    noise: AoaNoise | None = None,
) -> WirelessLog:
    """Profiles as bearings in the receiver's odometry axes; profiles without a peak are left out.

    Args:
        profiles: from `read_wsr_profiles`.
        stamps_ns: time of each trial, by its key.
        names: robot names by the toolbox's receiver ids and transmitter names; those not listed keep theirs.
        noise: sigma and weights of the paths; fitted defaults where None.

    Raises:
        InputError: a trial has no stamp.
    """
    names = names or {}
    missing = sorted({p.trial for p in profiles} - stamps_ns.keys())
    if missing:
        raise InputError(f"no stamp for WSR trial {missing[0]!r}; give every trial its time")
    measurements = tuple(
        WirelessMeasurement(
            stamp_ns=stamps_ns[profile.trial],
            receiver=names.get(profile.receiver, profile.receiver),
            transmitter=names.get(profile.transmitter, profile.transmitter),
            paths=profile.paths(noise or AoaNoise()),
            aoa_frame="odometry",
        )
        for profile in profiles
        if len(profile.azimuth)
    )
    return WirelessLog() + WirelessLog(measurements)


def read_wsr_matrix(
    path: Path | str, *, max_peaks: int = 5, min_height: float = 0.3, apart_rad: float = math.radians(15.0)
) -> tuple[AoaPath, ...]:
    """Paths of a profile matrix: azimuth rows over -180 to 180 degrees, polar elevation columns over 0 to 180.

    Peaks are local maxima of at least `min_height` of the highest, `apart_rad` from any higher one. Their weight is
    their height, their sigma the profile's width at the peak: the angle at which it falls to exp(-1/2) of it.

    Raises:
        InputError: the file is not a matrix of finite numbers >= 0 with a peak.
    """
    profile = _matrix(Path(path))
    rows, columns = profile.shape
    azimuth = -np.pi + 2 * np.pi * np.arange(rows) / rows
    polar = np.linspace(0.0, np.pi, columns) if columns > 1 else np.array([np.pi / 2])
    paths: list[AoaPath] = []
    for row, column in _local_maxima(profile, min_height):
        path_here = AoaPath(
            azimuth=float(azimuth[row]),
            sigma=_width_rad(profile[:, column], row),
            weight=float(profile[row, column] / profile.max()),
            elevation=float(np.pi / 2 - polar[column]) if columns > 1 else None,
        )
        if all(_angle(path_here, other) >= apart_rad for other in paths):
            paths.append(path_here)
        if len(paths) == max_peaks:
            break
    return tuple(paths)


def _profile(trial: str, record: Mapping[str, Any]) -> WsrProfile:
    transmitter, receiver = record["a_INFO_Transmitting_robot"], record["b_INFO_Receiving_robot"]
    found = record["d_INFO_AOA_profile"]
    ranked = found["Top_N_peaks"] or {}
    peaks = [ranked[rank] for rank in sorted(ranked, key=int)]
    azimuth = np.radians([float(peak["estimated_azimuth"]) for peak in peaks])
    polar = np.radians([float(peak["estimated_elevation"]) for peak in peaks])
    variance, true_azimuth = float(found["Profile_variance"]), transmitter.get("groundtruth_azimuth")
    if not (math.isfinite(variance) and np.isfinite(azimuth).all() and np.isfinite(polar).all()):
        raise ValueError("a number is not finite")
    if np.abs(azimuth).max(initial=0.0) > _LARGEST_RAD or np.abs(polar).max(initial=0.0) > _LARGEST_RAD:
        raise ValueError("an angle beyond two turns")
    planar = receiver.get("displacement_type") == "2D"
    return WsrProfile(
        trial=trial,
        receiver=str(receiver["id"]),
        transmitter=str(transmitter["Name"]),
        variance=variance,
        azimuth=azimuth,
        elevation=None if planar else np.clip(np.pi / 2 - polar, -np.pi / 2, np.pi / 2),
        true_azimuth=math.nan if true_azimuth is None else math.radians(float(true_azimuth)),
    )


def _matrix(path: Path) -> FloatArray:
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot read the profile matrix {path}: {error.strerror}; check the path") from error
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not a text file; expected a profile matrix as CSV") from error
    rows = [line.replace(",", " ").split() for line in text.splitlines() if line.strip()]
    try:
        profile = np.array([[float(cell) for cell in row] for row in rows])
    except ValueError as error:
        raise InputError(f"{path} is not a matrix of numbers ({error}); expected azimuth rows of one length") from error
    if profile.ndim != 2 or len(profile) < 8 or not np.isfinite(profile).all() or profile.min() < 0:
        raise InputError(f"{path} is no profile: expected at least 8 rows of finite numbers >= 0")
    if profile.max() == 0:
        raise InputError(f"{path} is a profile without a peak: all its values are 0")
    return profile


def _local_maxima(profile: FloatArray, min_height: float) -> list[tuple[int, int]]:
    """Rows and columns of the local maxima, highest first; azimuth wraps around, elevation does not."""
    padded = np.pad(np.pad(profile, ((1, 1), (0, 0)), mode="wrap"), ((0, 0), (1, 1)), constant_values=-1.0)
    neighbours = np.stack(
        [
            padded[1 + i : padded.shape[0] - 1 + i, 1 + j : padded.shape[1] - 1 + j]
            for i in (-1, 0, 1)
            for j in (-1, 0, 1)
            if (i, j) != (0, 0)
        ]
    )
    row, column = np.nonzero((profile >= neighbours.max(axis=0)) & (profile >= min_height * profile.max()))
    order = np.argsort(-profile[row, column], kind="stable")
    return [(int(row[k]), int(column[k])) for k in order]


def _width_rad(ring: FloatArray, peak: int) -> float:
    """Angle from the peak at which the profile falls to exp(-1/2) of it, the nearer side; at least one cell."""
    around = np.roll(ring, -peak)
    below = around < math.exp(-0.5) * around[0]
    if not below.any():
        return math.pi / 2
    cells = min(int(np.argmax(below)), int(np.argmax(below[::-1])) + 1)
    return float(min(cells * 2 * math.pi / len(ring), math.pi / 2))


def _angle(path: AoaPath, other: AoaPath) -> float:
    """Angle between two directions."""
    up, up_other = path.elevation or 0.0, other.elevation or 0.0
    cosine = math.sin(up) * math.sin(up_other)
    cosine += math.cos(up) * math.cos(up_other) * math.cos(path.azimuth - other.azimuth)
    return math.acos(max(-1.0, min(1.0, cosine)))
