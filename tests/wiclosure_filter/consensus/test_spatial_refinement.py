"""Frames that lean: noise-free measurements give the exact transform over all of SE(3)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.wiclosure_filter.consensus.refinement import Peaks
from wiclosure.wiclosure_filter.consensus.spatial_refinement import SpatialPeaks, refine_in_space

LEAN = np.array([0.25, -0.15, 0.0, 0.0, 0.0, 0.0])


def refined(case: object, tilt_sigma_rad: float = 100.0) -> SpatialPeaks:
    mixture, _ = case.problem.anchored_at(0)
    level = Peaks.at(case.state[None] + np.array([0.1, 1.0, -1.0, 0.5]), mixture, case.problem.prior)
    return refine_in_space(level, mixture, case.problem.prior, case.links, tilt_sigma_rad)


@pytest.mark.parametrize("kind", ["one-way", "reciprocal"])
@pytest.mark.parametrize("lean", [0.0, 1.0, 3.0])
def test_leaning_frames_are_found_exactly(kind: str, lean: float, make_case: Callable[..., object]) -> None:
    case = make_case(kind, elevated=True, tilt=lean * LEAN, heard=20, height_sigma_m=1e5)
    peaks = refined(case)
    b = case.trajectories["b"].positions
    np.testing.assert_allclose(
        se3.transform(peaks.T_a_b[0], b), se3.transform(case.T_a_b, b), atol=1e-3, err_msg=f"lean {lean}"
    )


def test_the_level_view_is_yaw_and_place_of_the_same_peak(make_case: Callable[..., object]) -> None:
    case = make_case(elevated=True, tilt=LEAN, heard=20, height_sigma_m=1e5)
    peaks = refined(case)
    assert len(peaks.level) == len(peaks.T_a_b)
    assert peaks.level.states[0, 0] == pytest.approx(float(se3.yaw(case.T_a_b)), abs=1e-4)
    centre = se3.transform(case.T_a_b, case.problem.observations.centre_b) - case.problem.observations.centre_a
    np.testing.assert_allclose(peaks.level.states[0, 1:], centre, atol=1e-3)
    assert (np.linalg.eigvalsh(peaks.level.information) > 0).all()
    assert (np.diff(peaks.level.log_posterior) <= 0).all()


def test_the_covariance_is_that_of_errors_in_bs_frame(make_case: Callable[..., object]) -> None:
    """Moving the odometry frame of b moves the covariance with it, and the tilt's prior narrows the tilt."""
    case = make_case(elevated=True, tilt=LEAN, heard=20, height_sigma_m=1e5)
    loose, tight = refined(case), refined(case, tilt_sigma_rad=0.05)
    assert (np.linalg.eigvalsh(loose.covariance) > 0).all()
    assert np.trace(tight.covariance[0, :2, :2]) < np.trace(loose.covariance[0, :2, :2])
    observations = case.problem.observations
    at_centre = se3.rotate_covariance(
        se3.adjoint(se3.inverse(se3.from_yaw(0.0, observations.centre_b))), loose.covariance[0]
    )
    assert np.trace(at_centre[3:, 3:]) < np.trace(loose.covariance[0, 3:, 3:])  # surest where it was measured
