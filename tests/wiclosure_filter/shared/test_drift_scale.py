"""Drift scale from links: two poses whose distance is held from outside."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest

from wiclosure.wiclosure_filter.covariance.cliques import Eliminated
from wiclosure.wiclosure_filter.covariance.square_root import SquareRoot
from wiclosure.wiclosure_filter.shared.drift_scale import drift_scale

SIGMA = 0.1


def scale_of(residual_sigmas: float, held_sigma: float = 1e-5, prior_weight: float = 2.0) -> float:
    """Odometry tells a step of 1 m; the second pose is held so many standard deviations further on."""
    step = gtsam.Pose3(gtsam.Rot3(), np.array([1.0, 0.0, 0.0]))
    held = gtsam.Pose3(gtsam.Rot3(), np.array([1.0 + residual_sigmas * SIGMA, 0.0, 0.0]))
    odometry, others, values = gtsam.NonlinearFactorGraph(), gtsam.NonlinearFactorGraph(), gtsam.Values()
    odometry.add(gtsam.BetweenFactorPose3(0, 1, step, gtsam.noiseModel.Isotropic.Sigma(6, SIGMA)))
    others.add(gtsam.PriorFactorPose3(0, gtsam.Pose3(), gtsam.noiseModel.Isotropic.Sigma(6, 1e-5)))
    others.add(gtsam.PriorFactorPose3(1, held, gtsam.noiseModel.Isotropic.Sigma(6, held_sigma)))
    values.insert(0, gtsam.Pose3())
    values.insert(1, held)
    whole = gtsam.NonlinearFactorGraph()
    whole.push_back(odometry)
    whole.push_back(others)
    root = SquareRoot.of(Eliminated.of(whole.linearize(values)))
    return drift_scale(odometry, odometry, values, root, robots=1, prior_weight=prior_weight)


@pytest.mark.parametrize("sigmas", [0.0, 1.0, 3.0, 10.0])
def test_residuals_over_determined_parameters(sigmas: float) -> None:
    """The held pose determines all six parameters of the step: the mean of an inverse gamma distribution."""
    assert scale_of(sigmas) == pytest.approx(np.sqrt((4.0 + sigmas**2) / (4.0 + 6.0 - 2.0)), rel=1e-3)


def test_a_heavy_drift_model_is_never_scaled() -> None:
    assert scale_of(30.0, prior_weight=1e9) == pytest.approx(1.0, abs=1e-3)


def test_what_links_do_not_determine_does_not_count() -> None:
    """A vague link determines next to nothing: odometry without residuals is not taken for better, but for unknown."""
    assert scale_of(0.0, held_sigma=1e3) == pytest.approx(np.sqrt(2.0), abs=1e-3)
