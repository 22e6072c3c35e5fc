"""Units that inertial measurements may be stated in."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from wiclosure.types import ImuLog

GRAVITY_UNIT = 9.80665  # m/s^2 a g
ACCELERATION_UNITS: Mapping[str, float] = {"m/s^2": 1.0, "g": GRAVITY_UNIT, "mg": GRAVITY_UNIT / 1000.0}
RATE_UNITS: Mapping[str, float] = {"rad/s": 1.0, "deg/s": float(np.radians(1.0))}


def converted(log: ImuLog, units: Sequence[str] | None) -> ImuLog:
    """In m/s^2 and rad/s."""
    if units is None:
        return log
    acceleration, rate = ACCELERATION_UNITS[units[0]], RATE_UNITS[units[1]]
    return ImuLog(log.stamps_ns, acceleration * log.acceleration, rate * log.turning_rate)
