"""Units of inertial measurements."""

from __future__ import annotations

import numpy as np

from wiclosure.pipeline.data.navigation.imu_units import ACCELERATION_UNITS, RATE_UNITS, converted
from wiclosure.types import ImuLog

LOG = ImuLog(np.arange(1), np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 1.0]]))


def test_every_unit_and_none():
    assert converted(LOG, None) is LOG
    for acceleration, metres in ACCELERATION_UNITS.items():
        for rate, radians in RATE_UNITS.items():
            log = converted(LOG, (acceleration, rate))
            np.testing.assert_allclose([log.acceleration[0, 2], log.turning_rate[0, 2]], [metres, radians])
    assert ACCELERATION_UNITS["g"] == 9.80665
    assert RATE_UNITS["deg/s"] == np.radians(1.0)
