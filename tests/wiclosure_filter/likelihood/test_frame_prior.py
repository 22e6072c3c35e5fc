"""What gravity and the ground tell of an odometry frame."""

from __future__ import annotations

import numpy as np

from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.likelihood.frame_prior import UNKNOWN_M, UNKNOWN_RAD, FramePrior


def test_level_frames_lean_by_gravity_of_both() -> None:
    prior = FramePrior.of(AlignmentSettings(height_sigma_m=4.0), gravity_sigma_rad=0.05)
    tilt = 0.05 * np.sqrt(2)
    np.testing.assert_allclose(prior.sigmas, [tilt, tilt, UNKNOWN_RAD, UNKNOWN_M, UNKNOWN_M, 4.0])
    np.testing.assert_allclose(prior.covariance, np.diag(prior.sigmas**2))
    assert prior.dimensions == 2


def test_other_frames_lean_as_the_settings_say() -> None:
    prior = FramePrior.of(AlignmentSettings(gravity_aligned=False, tilt_sigma_rad=0.3), gravity_sigma_rad=0.05)
    np.testing.assert_allclose(prior.sigmas[:2], 0.3)
    assert prior.dimensions == 3
