"""What robots learn of each other, and of north, without a LiDAR: ranges, directions of arrival, headings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Self, TypeAlias

import numpy as np

from wiclosure.errors import InputError

AoaFrame: TypeAlias = Literal["body", "odometry", "world"]


@dataclass(frozen=True, slots=True)
class AoaPath:
    """One direction from which a signal arrived: a mode of an angle-of-arrival profile.

    Args:
        azimuth: rad, counter-clockwise from x forward.
        sigma: rad, standard deviation.
        weight: how likely this mode is the direct path, relative to the other modes of the same measurement.
        elevation: rad, up from the horizontal plane, or None where the antenna cannot tell.
    """

    azimuth: float
    sigma: float
    weight: float = 1.0
    elevation: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.azimuth) and math.isfinite(self.sigma) and math.isfinite(self.weight)):
            raise InputError(f"path {self} holds a number that is not finite")
        if self.sigma <= 0:
            raise InputError(f"path sigma is {self.sigma}; it must be > 0 (radians)")
        if self.weight < 0:
            raise InputError(f"path weight is {self.weight}; it must be >= 0")
        if self.elevation is not None and not abs(self.elevation) <= np.pi / 2 + 1e-6:
            raise InputError(f"path elevation is {self.elevation}; it must lie within -pi/2 and pi/2 (radians)")


@dataclass(frozen=True, slots=True)
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
        if self.receiver == self.transmitter:
            raise InputError(f"wireless measurement from {self.receiver!r} to itself")
        if self.range_m is None and not self.paths:
            raise InputError("wireless measurement without range and without paths")
        if self.range_m is not None:
            if not (math.isfinite(self.range_m) and self.range_m >= 0):
                raise InputError(f"range is {self.range_m}; it must be a number >= 0 (metres)")
            if self.range_sigma_m is None or not (math.isfinite(self.range_sigma_m) and self.range_sigma_m > 0):
                raise InputError(f"range_sigma is {self.range_sigma_m}; it must be a number > 0 (metres)")
        if self.aoa_frame not in {"body", "odometry", "world"}:
            raise InputError(f"aoa_frame is {self.aoa_frame!r}; expected body, odometry or world")
        for name in ("lever_arm_receiver", "lever_arm_transmitter"):
            arm = getattr(self, name)
            if len(arm) != 3 or not all(map(math.isfinite, arm)):
                raise InputError(f"{name} is {arm}; expected three finite numbers (metres)")


@dataclass(frozen=True, slots=True)
class Heading:
    """A compass or AHRS reading: yaw of the robot's body in the common world axes, radians."""

    stamp_ns: int
    robot: str
    heading: float
    sigma: float

    def __post_init__(self) -> None:
        if not np.isfinite(self.heading):
            raise InputError(f"heading is {self.heading}; it must be finite (radians)")
        if not (np.isfinite(self.sigma) and self.sigma > 0):
            raise InputError(f"heading sigma is {self.sigma}; it must be a number > 0 (radians)")


@dataclass(frozen=True, slots=True)
class WirelessLog:
    """All that was heard: measurements and headings, each in order of time."""

    measurements: tuple[WirelessMeasurement, ...] = ()
    headings: tuple[Heading, ...] = ()

    def __add__(self, other: Self) -> WirelessLog:
        return WirelessLog(
            tuple(sorted(self.measurements + other.measurements, key=lambda m: m.stamp_ns)),
            tuple(sorted(self.headings + other.headings, key=lambda h: h.stamp_ns)),
        )

    def robots(self) -> set[str]:
        """Names of all robots that occur."""
        return {r for m in self.measurements for r in (m.receiver, m.transmitter)} | {h.robot for h in self.headings}
