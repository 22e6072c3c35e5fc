from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.frontends.config import RegistrationSettings
from wiclosure.frontends.registration.methods import METHODS, CoarseToFineGicp, PointToPointIcp
from wiclosure.frontends.registration.prepared_cloud import PreparedCloud
from wiclosure.frontends.registration.result import RegistrationResult
from wiclosure.types import FloatArray, RegistrationEvidence

SETTINGS = RegistrationSettings()


def yard(T_body_world: FloatArray, voxels_m: tuple[float, ...], seed: int = 0) -> PreparedCloud:
    """Walls of a yard with a house in it and the ground, sampled anew for each seed."""
    rng = np.random.default_rng(seed)
    n = 3000
    along, height = rng.uniform(-1, 1, (6, n)), rng.uniform(-1.5, 4, (6, n))
    walls = [
        np.column_stack([20 * along[0], np.full(n, -12.0), height[0]]),
        np.column_stack([20 * along[1], np.full(n, 12.0), height[1]]),
        np.column_stack([np.full(n, 20.0), 12 * along[2], height[2]]),
        np.column_stack([np.full(n, 6.0), -8 + 3 * along[3], height[3]]),
        np.column_stack([9 + 3 * along[4], np.full(n, -5.0), height[4]]),
        np.column_stack([20 * along[5], rng.uniform(-12, 12, n), np.full(n, -1.5)]),
    ]
    return PreparedCloud.of(se3.transform(T_body_world, np.concatenate(walls)).astype(np.float32), voxels_m, 1)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("off", [0.0, 1.0])
def test_the_pose_between_two_clouds_is_measured_from_a_start_beside_it(name: str, off: float) -> None:
    method, T_query_match = METHODS[name], se3.from_yaw(0.2, np.array([1.5, -0.7, 0.1]))
    voxels_m = method.voxel_sizes_m(0.5)
    query, match = yard(np.eye(4), voxels_m), yard(se3.inverse(T_query_match), voxels_m, seed=1)
    start = T_query_match @ se3.from_yaw(0.1 * off, np.array([0.6, -0.4, 0.0]) * off)
    (found,) = method.measure(query, match, start[None], SETTINGS)
    gap = se3.between(T_query_match, found.T_query_match)
    assert np.linalg.norm(gap[:3, 3]) < 0.1
    assert se3.rotation_angle(gap) < 0.01
    assert method.objection(found, SETTINGS, predicted=False) == ""


def test_starts_that_reach_one_optimum_are_one_result_and_at_most_two_are_refined() -> None:
    method = CoarseToFineGicp()
    query, match = yard(np.eye(4), method.voxel_sizes_m(0.5)), yard(np.eye(4), method.voxel_sizes_m(0.5), seed=1)
    near = [se3.from_yaw(yaw, np.array([0.5, yaw, 0.0])) for yaw in (-0.1, 0.0, 0.1)]
    assert len(method.measure(query, match, np.stack(near), SETTINGS)) == 1
    around = [se3.from_yaw(yaw, np.zeros(3)) for yaw in np.linspace(0, 2 * np.pi, 8, endpoint=False)]
    found = method.measure(query, match, np.stack(around), SETTINGS)
    assert len(found) <= 2
    assert max(found, key=lambda result: result.score) is found[0]


def test_resolutions() -> None:
    assert CoarseToFineGicp().voxel_sizes_m(0.25) == (1.0, 0.5, 0.25)
    assert PointToPointIcp().voxel_sizes_m(0.25) == (0.4,)


FINE = RegistrationEvidence(inliers=500, inlier_ratio=0.9, agreement=0.99, rms_m=0.1)


@pytest.mark.parametrize(
    ("change", "alone", "predicted"),
    [
        ({}, "", ""),
        ({"inliers": 99}, "only 99 points of structure match, 100 needed", "only 99 points"),
        ({"inlier_ratio": 0.3}, "only 0.30 of the structure matches, 0.40 needed", ""),
        ({"inlier_ratio": 0.2}, "only 0.20 of the structure", "only 0.20 of the structure matches, 0.25 needed"),
        ({"agreement": 0.92}, "free-space conflict: agreement 0.92, 0.94 needed", ""),
        ({"agreement": 0.9396}, "free-space conflict: agreement 0.9396, 0.9400 needed", ""),
        ({"agreement": 0.5}, "free-space conflict", "free-space conflict: agreement 0.50, 0.90 needed"),
    ],
)
def test_gicp_asks_less_of_what_agrees_with_a_prediction(change: dict, alone: str, predicted: str) -> None:
    result = RegistrationResult(np.eye(4), np.eye(6), replace(FINE, **change))
    method = CoarseToFineGicp()
    for text, with_prediction in ((alone, False), (predicted, True)):
        objection = method.objection(result, SETTINGS, predicted=with_prediction)
        assert objection.startswith(text)
        assert bool(objection) == bool(text)


def test_point_to_point_asks_for_a_small_mean_squared_distance() -> None:
    worse = RegistrationResult(np.eye(4), 5.1 * np.eye(6), FINE)
    method = PointToPointIcp()
    assert method.objection(worse, SETTINGS, predicted=True) == "mean squared distance 5.1 m^2, at most 5 allowed"
    assert method.objection(replace(worse, covariance=4.9 * np.eye(6)), SETTINGS, predicted=False) == ""
