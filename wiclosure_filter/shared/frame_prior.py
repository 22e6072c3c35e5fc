"""How an odometry frame lies in another before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.config import AlignmentSettings

# Sigmas of what nothing is known of, small enough for well-conditioned equations.
UNKNOWN_M, UNKNOWN_RAD = 1e4, 3.0


@dataclass(frozen=True, eq=False)
class FramePrior:
    """What gravity and the ground tell.

    Args:
        sigmas: `(6,)` standard deviations, rotation first: tilt, and roughly the height; hardly more.
        dimensions: 2 where frames agree on the vertical, so that displacements are compared in the plane; 3 in space.
    """

    sigmas: FloatArray
    dimensions: int

    @classmethod
    def of(cls, settings: AlignmentSettings, gravity_sigma_rad: float) -> FramePrior:
        """Of frames whose z points up within `gravity_sigma_rad` each, or that lean as the settings say."""
        tilt = np.sqrt(2.0) * gravity_sigma_rad if settings.gravity_aligned else settings.tilt_sigma_rad
        sigmas = np.array([tilt, tilt, UNKNOWN_RAD, UNKNOWN_M, UNKNOWN_M, settings.height_sigma_m])
        return cls(sigmas, 2 if settings.gravity_aligned else 3)

    @property
    def covariance(self) -> FloatArray:
        """`(6, 6)`."""
        return np.diag(np.square(self.sigmas))
