from __future__ import annotations

import numpy as np
import pytest
import small_gicp

from wiclosure import se3
from wiclosure.frontends.registration.prepared_cloud import PreparedCloud
from wiclosure.frontends.registration.result import RegistrationResult
from wiclosure.types import FloatArray, Prediction, PredictionKind

EXACT = np.diag(np.square([0.01, 0.01, 0.01, 0.1, 0.1, 0.1]))


def walls(seed: int) -> PreparedCloud:
    """Three walls around the sensor, at resolutions of 1 and 0.5 m."""
    rng = np.random.default_rng(seed)
    along, height = rng.uniform(-15, 15, (2, 6000)), rng.uniform(-1.5, 5, (3, 6000))
    sides = [np.column_stack([along[k], np.full(6000, y), height[k]]) for k, y in enumerate((-10.0, 10.0))]
    front = np.column_stack([np.full(6000, 15.0), rng.uniform(-10, 10, 6000), height[2]])
    return PreparedCloud.of(np.concatenate([*sides, front]).astype(np.float32), (1.0, 0.5), 1)


def test_the_same_walls_agree_where_they_are_and_less_a_metre_and_a_half_off() -> None:
    query, match = walls(0), walls(1)
    right = RegistrationResult.of(query, match, np.eye(4), EXACT)
    wrong = RegistrationResult.of(query, match, se3.from_yaw(0.0, np.array([0.0, 1.5, 0.0])), EXACT)
    assert right.evidence.inlier_ratio > 0.98
    assert right.evidence.agreement > 0.99
    assert right.evidence.rms_m < 0.3
    assert right.evidence.inliers == pytest.approx(len(query.structure) + len(match.structure), rel=0.02)
    assert wrong.evidence.inlier_ratio < 0.6
    # One wall of either cloud stands well before the other's: in free space.
    assert wrong.evidence.agreement < 0.9
    assert wrong.score < 0.1 * right.score


def test_clouds_that_share_nothing_have_no_matches_and_no_score() -> None:
    result = RegistrationResult.of(walls(0), walls(1), se3.from_yaw(0.0, np.array([500.0, 0.0, 0.0])), EXACT)
    assert (result.evidence.inliers, result.evidence.inlier_ratio, result.score) == (0, 0.0, 0.0)
    assert np.isnan(result.evidence.rms_m)


def test_chi_square_counts_the_distance_from_the_prediction_in_sigmas_of_both() -> None:
    result = RegistrationResult.of(walls(0), walls(1), np.eye(4), EXACT)
    off = Prediction(se3.from_yaw(0.0, np.array([-0.3, 0.0, 0.0])), 3 * EXACT, PredictionKind.POSE)
    assert result.chi2(off) == pytest.approx(0.3**2 / (4 * 0.1**2))
    measured = result.measured(result.chi2(off))
    assert measured.evidence is not None
    assert measured.evidence.prediction_chi2 == result.chi2(off)
    assert result.evidence.prediction_chi2 is None


def test_the_hessian_of_small_gicp_perturbs_on_the_right_rotation_first() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform([-10, -10, 0], [10, 10, 3], (1500, 3))
    points[rng.random(1500) < 0.5, 2] = 0
    T_target_source = se3.exp(np.array([0.02, -0.03, 0.5, 3.0, 1.0, 0.2]))
    target, tree = small_gicp.preprocess_points(points, 0.5)
    source, _ = small_gicp.preprocess_points(se3.transform(se3.inverse(T_target_source), points), 0.5)
    found = small_gicp.align(target, source, tree, T_target_source)
    factor, rejector = small_gicp.GICPFactor(), small_gicp.DistanceRejector()
    rejector.set_max_distance(1.0)

    def gradient(pose: FloatArray) -> FloatArray:
        rows = [factor.linearize(target, source, tree, pose, i, rejector) for i in range(source.size())]
        return np.asarray(sum(b.ravel() for success, _, b, _ in rows if success))

    at_rest = gradient(found.T_target_source)
    for axis in (3, 4, 5):
        step = np.zeros(6)
        step[axis] = 1e-5
        change = (gradient(found.T_target_source @ se3.exp(step)) - at_rest) / 1e-5
        np.testing.assert_allclose(change, found.H[:, axis], atol=0.02 * np.abs(found.H[:, axis]).max())
