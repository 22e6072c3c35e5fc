"""How an odometry frame lies in another before anything is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from wiclosure.types import FloatArray, Trajectory
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.likelihood.heights import height_sigma_m

# Sigmas of what nothing is known of, small enough for well-conditioned equations.
UNKNOWN_M, UNKNOWN_RAD = 1e4, 3.0


@dataclass(frozen=True, eq=False)
class FramePrior:
    """What gravity and the ground tell.

    Args:
        sigmas: `(6,)` standard deviations, rotation first: tilt, and roughly the height; hardly more.
        settings: of the alignment, which tell how differently high robots that hear each other may be.
        dimensions: 2 where frames agree on the vertical, so that displacements are compared in the plane; 3 in space.
    """

    sigmas: FloatArray
    dimensions: int
    settings: AlignmentSettings

    @classmethod
    def of(cls, settings: AlignmentSettings, gravity_sigma_rad: float) -> FramePrior:
        """Of frames whose z points up within `gravity_sigma_rad` each, or that lean as the settings say."""
        tilt = np.sqrt(2.0) * gravity_sigma_rad if settings.gravity_aligned else settings.tilt_sigma_rad
        sigmas = np.array([tilt, tilt, UNKNOWN_RAD, UNKNOWN_M, UNKNOWN_M, settings.height_sigma_m])
        return cls(sigmas, 2 if settings.gravity_aligned else 3, settings)

    def height_sigma_m(self, a: Trajectory, b: Trajectory, distance_m: float) -> float | None:
        """Of the heights of two robots that heard each other so far apart; None in space."""
        return height_sigma_m(a, b, distance_m, self.settings) if self.settings.gravity_aligned else None

    @property
    def covariance(self) -> FloatArray:
        """`(6, 6)`."""
        return np.diag(np.square(self.sigmas))
