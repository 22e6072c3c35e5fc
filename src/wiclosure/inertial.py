"""What an inertial measurement unit recorded."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.arrays import FloatArray, IntArray, float_array, stamp_array
from wiclosure.errors import InputError


@dataclass(frozen=True, eq=False, repr=False)
class ImuLog:
    """Samples of one IMU in its own axes.

    Args:
        stamps_ns: `(N,)` int64, strictly increasing.
        acceleration: `(N, 3)` specific force, m/s^2: at rest it points up and is 9.81 long.
        turning_rate: `(N, 3)` rad/s.

    Raises:
        InputError: shapes that do not belong together, or stamps that do not increase.
    """

    stamps_ns: IntArray
    acceleration: FloatArray
    turning_rate: FloatArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "stamps_ns", stamp_array(self.stamps_ns, "IMU: stamps"))
        for name in ("acceleration", "turning_rate"):
            object.__setattr__(self, name, float_array(getattr(self, name), f"IMU: {name}"))
            shape = getattr(self, name).shape
            if shape != (len(self.stamps_ns), 3):
                raise InputError(f"IMU: {len(self.stamps_ns)} stamps but {name} of shape {shape}; expected (N, 3)")
        if (np.diff(self.stamps_ns) <= 0).any():
            raise InputError("IMU: stamps do not increase; sort the samples by time and drop repeated ones")

    def __repr__(self) -> str:
        seconds = float(np.ptp(self.stamps_ns)) * 1e-9 if len(self) else 0.0
        return f"ImuLog({len(self)} samples, {seconds:.1f} s)"

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def subset(self, rows: np.ndarray) -> ImuLog:
        """The samples at `rows`, boolean or indices."""
        return ImuLog(self.stamps_ns[rows], self.acceleration[rows], self.turning_rate[rows])

    def turned(self, R_body_imu: FloatArray) -> ImuLog:
        """The same samples in the axes of a body `(3, 3)`."""
        return ImuLog(self.stamps_ns, self.acceleration @ R_body_imu.T, self.turning_rate @ R_body_imu.T)
