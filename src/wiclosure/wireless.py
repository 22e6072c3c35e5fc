"""What robots learn of each other, and of north, without a LiDAR: ranges, directions of arrival, headings."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from numbers import Real
from typing import Literal, Self, TypeAlias, TypeVar

from wiclosure.arrays import stamp
from wiclosure.errors import InputError

AoaFrame: TypeAlias = Literal["body", "odometry", "world"]

_Entry = TypeVar("_Entry")

FARTHEST_M = 1e6
"""Of a range, in millimetres too: no radio of robots reaches further."""
_LONGEST_ARM_M = 100.0  # from a robot's body to its antenna
_SMALLEST_SIGMA, _LARGEST_SIGMA_M = 1e-6, 1e6
_LARGEST_SIGMA_RAD = 1e6  # of an angle: beyond a few turns it says nothing anyway
_HEAVIEST, _MOST_TURNS = 1e9, 1000
TURN_RAD = 2 * math.pi + 1e-6
"""Angles beyond a turn are no radians, or count turns."""
_UPRIGHT_RAD = math.pi / 2 + 1e-6


class RangeError(InputError):
    """One measurement with a number that nothing real has; others of its file may be right."""


@dataclass(frozen=True, slots=True, repr=False)
class AoaPath:
    """One direction from which a signal arrived: a mode of an angle-of-arrival profile.

    Args:
        azimuth: rad, counter-clockwise from x forward, within one turn.
        sigma: rad, standard deviation.
        weight: how likely this mode is the direct path, relative to the other modes of the same measurement.
        elevation: rad, up from the horizontal plane, or None where the antenna cannot tell.

    Raises:
        InputError: a number that is none, or beyond its range, as angles in degrees are.
    """

    azimuth: float
    sigma: float
    weight: float = 1.0
    elevation: float | None = None

    def __post_init__(self) -> None:
        for name in ("azimuth", "sigma", "weight"):
            _require_finite(f"path {name}", getattr(self, name))
        if abs(self.azimuth) > TURN_RAD:
            raise InputError(f"path azimuth is {self.azimuth}; it must lie within -2 pi and 2 pi (radians)")
        if self.sigma <= 0:
            raise InputError(f"path sigma is {self.sigma}; it must be > 0 (radians)")
        if self.weight < 0:
            raise InputError(f"path weight is {self.weight}; it must be >= 0")
        _require_within("path sigma", self.sigma, _SMALLEST_SIGMA, _LARGEST_SIGMA_RAD, "radians")
        _require_within("path weight", self.weight, 0.0, _HEAVIEST, "a share")
        if self.elevation is not None:
            _require_finite("path elevation", self.elevation)
            if abs(self.elevation) > _UPRIGHT_RAD:
                raise InputError(f"path elevation is {self.elevation}; it must lie within -pi/2 and pi/2 (radians)")

    def __repr__(self) -> str:
        upwards = "" if self.elevation is None else f", elevation {self.elevation:.3f}"
        return f"AoaPath({self.azimuth:.3f} rad{upwards}, sigma {self.sigma:.3f}, weight {self.weight:.2f})"


@dataclass(frozen=True, slots=True, repr=False)
class WirelessMeasurement:
    """What the receiver learnt from one exchange with the transmitter: a range, directions, or both.

    Args:
        stamp_ns: receiver's time.
        receiver: robot that measured.
        transmitter: robot whose signal was measured.
        range_m: distance between the antennas, or None.
        range_sigma_m: its standard deviation; required with a range.
        paths: directions of arrival; the direct one is at most one of them, and may be missing. Empty: no direction.
        aoa_frame: axes of the directions: `body` (receiver's, at the stamp), `odometry` (receiver's odometry frame) or
            `world` (the axes that `Heading` refers to).
        transmitter_stamp_ns: time at the transmitter, where it differs.
        lever_arm_receiver: `(x, y, z)` of the antenna in the receiver's body frame, metres.
        lever_arm_transmitter: the same at the transmitter.

    Raises:
        InputError: stamps that are no integers, a robot that hears itself, neither a range nor a direction, or a number
            that is none or beyond its range.  Lists of paths are converted.
    """

    stamp_ns: int
    receiver: str
    transmitter: str
    range_m: float | None = None
    range_sigma_m: float | None = None
    paths: tuple[AoaPath, ...] = ()
    aoa_frame: AoaFrame = "body"
    transmitter_stamp_ns: int | None = None
    lever_arm_receiver: tuple[float, float, float] = (0.0, 0.0, 0.0)
    lever_arm_transmitter: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", stamp(self.stamp_ns, "stamp_ns of a wireless measurement"))
        if (sent_ns := self.transmitter_stamp_ns) is not None:
            object.__setattr__(self, "transmitter_stamp_ns", stamp(sent_ns, "transmitter_stamp_ns of a measurement"))
        object.__setattr__(self, "paths", _all_of(AoaPath, self.paths, "paths of a wireless measurement"))
        if self.receiver == self.transmitter:
            raise InputError(f"wireless measurement from {self.receiver!r} to itself")
        if self.range_m is None and not self.paths:
            raise InputError("wireless measurement without range and without paths")
        if self.range_m is not None:
            _require_finite("range", self.range_m)
            if self.range_m < 0:
                raise InputError(f"range is {self.range_m}; it must be a number >= 0 (metres)")
            if self.range_sigma_m is None or not (math.isfinite(self.range_sigma_m) and self.range_sigma_m > 0):
                raise InputError(f"range_sigma is {self.range_sigma_m}; it must be a number > 0 (metres)")
            _require_within("range", self.range_m, 0.0, FARTHEST_M, "metres")
            _require_within("range_sigma", self.range_sigma_m, _SMALLEST_SIGMA, _LARGEST_SIGMA_M, "metres")
        if self.aoa_frame not in {"body", "odometry", "world"}:
            raise InputError(f"aoa_frame is {self.aoa_frame!r}; expected body, odometry or world")
        for name in ("lever_arm_receiver", "lever_arm_transmitter"):
            arm = tuple(getattr(self, name))
            if len(arm) != 3 or not all(map(math.isfinite, arm)):
                raise InputError(f"{name} is {arm}; expected three finite numbers (metres)")
            _require_within(name, max(map(abs, arm)), 0.0, _LONGEST_ARM_M, "metres")
            object.__setattr__(self, name, arm)

    def __repr__(self) -> str:
        told = [] if self.range_m is None else [f"{self.range_m:.2f} m"]
        told += [f"{_counted(len(self.paths), 'path')} in {self.aoa_frame} axes"] if self.paths else []
        return (
            f"WirelessMeasurement({self.receiver!r} hears {self.transmitter!r} at {_seconds(self.stamp_ns)},"
            f" {', '.join(told)})"
        )


@dataclass(frozen=True, slots=True, repr=False)
class Heading:
    """A compass or AHRS reading.

    Args:
        stamp_ns: the robot's time.
        robot: its name.
        heading: rad, yaw of its body in the common world axes; turns may have been counted.
        sigma: rad, standard deviation.

    Raises:
        InputError: a stamp that is no integer, or a number that is none or beyond its range.
    """

    stamp_ns: int
    robot: str
    heading: float
    sigma: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamp_ns", stamp(self.stamp_ns, "stamp_ns of a heading"))
        _require_finite("heading", self.heading)
        _require_finite("heading sigma", self.sigma)
        if self.sigma <= 0:
            raise InputError(f"heading sigma is {self.sigma}; it must be a number > 0 (radians)")
        _require_within("heading sigma", self.sigma, _SMALLEST_SIGMA, _LARGEST_SIGMA_RAD, "radians")
        _require_within("heading", abs(self.heading), 0.0, _MOST_TURNS * TURN_RAD, "radians")

    def __repr__(self) -> str:
        return f"Heading({self.robot!r} at {_seconds(self.stamp_ns)}, {self.heading:.3f} rad, sigma {self.sigma:.3f})"


@dataclass(frozen=True, slots=True, repr=False)
class WirelessLog:
    """All that was heard: measurements and headings, each in order of time.

    Raises:
        InputError: an entry of another type.  Lists are converted.
    """

    measurements: tuple[WirelessMeasurement, ...] = ()
    headings: tuple[Heading, ...] = ()

    def __post_init__(self) -> None:
        measurements = _all_of(WirelessMeasurement, self.measurements, "measurements of a wireless log")
        object.__setattr__(self, "measurements", measurements)
        object.__setattr__(self, "headings", _all_of(Heading, self.headings, "headings of a wireless log"))

    def __repr__(self) -> str:
        stamps = [m.stamp_ns for m in self.measurements] + [h.stamp_ns for h in self.headings]
        if not stamps:
            return "WirelessLog(empty)"
        counts = f"{_counted(len(self.measurements), 'measurement')}, {_counted(len(self.headings), 'heading')}"
        span_s = (max(stamps) - min(stamps)) * 1e-9
        return f"WirelessLog({counts}, of {', '.join(sorted(self.robots()))}, {span_s:.1f} s)"

    def __add__(self, other: Self) -> WirelessLog:
        return WirelessLog(
            tuple(sorted(self.measurements + other.measurements, key=lambda m: m.stamp_ns)),
            tuple(sorted(self.headings + other.headings, key=lambda h: h.stamp_ns)),
        )

    def robots(self) -> set[str]:
        """Names of all robots that occur."""
        return {r for m in self.measurements for r in (m.receiver, m.transmitter)} | {h.robot for h in self.headings}


def _require_finite(name: str, value: object) -> None:
    if not (isinstance(value, Real) and math.isfinite(value)):
        raise InputError(f"{name} is {value}; it must be a finite number")


def _require_within(name: str, value: float, low: float, high: float, unit: str) -> None:
    if not low <= value <= high:
        raise RangeError(f"{name} is {value:g}; it must lie within {low:g} and {high:g} ({unit})")


def _all_of(kind: type[_Entry], entries: Iterable[_Entry], name: str) -> tuple[_Entry, ...]:
    """The entries as a tuple, all of one kind."""
    found = tuple(entries)
    for entry in found:
        if not isinstance(entry, kind):
            raise InputError(f"{name}: expected {kind.__name__}, got a {type(entry).__name__}")
    return found


def _seconds(stamp_ns: int) -> str:
    return f"{stamp_ns * 1e-9:.3f} s"


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
