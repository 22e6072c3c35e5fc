"""Each pair of poses through one link: equations 13 and 14 by hand."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import AlignmentHypothesis, AoaPath, FrameAlignment, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks
from wiclosure.wiclosure_filter.shared.shortest_route import ShortestRouteEstimate

SIZE = 41
T_A_B = se3.from_yaw(0.4, np.array([5.0, 12.0, 0.0]))
WALK = DriftModel(
    translation_walk=0.1, rotation_walk=1e-6, rotation_walk_turning=1e-6, translation_bias=0.0, rotation_bias=0.0
)


def straight(robot: str) -> Trajectory:
    x = np.arange(SIZE, dtype=float)
    poses = se3.from_yaw(np.zeros(SIZE), np.stack([x, 0 * x, 0 * x], axis=1))
    return Trajectory(robot, np.arange(SIZE, dtype=np.int64) * 10**9, poses, WALK)


TEAM = {"a": straight("a"), "b": straight("b")}


def estimate(*keyframes: int, ranged: bool = True) -> ShortestRouteEstimate | None:
    measurements, kept = [], []
    for number, k in enumerate(keyframes):
        seen = se3.between(TEAM["a"].poses[k], T_A_B @ TEAM["b"].poses[k])[:3, 3]
        path = AoaPath(float(np.arctan2(seen[1], seen[0])), 0.02, elevation=0.0)
        distance = float(np.linalg.norm(seen)) if ranged else None
        measurements.append(WirelessMeasurement(k * 10**9, "a", "b", distance, 0.3 if ranged else None, (path,)))
        kept.append((number, 0))
    links = TeamLinks.of(TEAM, WirelessLog(tuple(measurements)), GatheringLimits.of(AlignmentSettings()))
    hypothesis = AlignmentHypothesis(T_A_B, 0.0, tuple(kept))
    alignment = FrameAlignment("a", "b", hypothesis, 1e-6 * np.eye(6), False, "made for a test")
    return ShortestRouteEstimate.of(KeptLinks.of(hypothesis, links.by_pair["a", "b"]), alignment, TEAM, 2)


def test_poses_are_composed_over_the_nearest_link() -> None:
    found = estimate(5, 35)
    assert found is not None
    p, k = (grid.ravel() for grid in np.indices((SIZE, SIZE)))
    T, covariance = found.relative_poses("a", p, "b", k)
    np.testing.assert_allclose(T, se3.between(TEAM["a"].poses[p], T_A_B @ TEAM["b"].poses[k]), atol=1e-9)
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_drift_adds_up_along_the_route() -> None:
    found = estimate(5)
    assert found is not None
    p, k = (grid.ravel() for grid in np.indices((SIZE, SIZE)))
    _, covariance = found.relative_poses("a", p, "b", k)
    # Drift is counted from keyframe to link and from link to keyframe: 0.01 m^2 a metre (eq. 14).
    metres = np.abs(p - 5) + np.abs(k - 5)
    at_link = covariance[(p == 5) & (k == 5)][0, 5, 5]
    expected = at_link + 0.01 * metres
    np.testing.assert_allclose(covariance[:, 5, 5], expected, rtol=1e-3, atol=1e-3)


def test_one_model_answers_for_each_pair() -> None:
    found = estimate(5, 35)
    assert found is not None
    p, k = (grid.ravel() for grid in np.indices((SIZE, SIZE)))
    applies = np.array([model.applies(p, k) for model in found.models("a", "b")])
    assert (applies.sum(axis=0) == 1).all()
    near_first = np.abs(p - 5) + np.abs(k - 5) < np.abs(p - 35) + np.abs(k - 35)
    assert applies[0][near_first].all()
    assert not found.models("b", "a")


def test_at_the_link_the_error_is_the_links_own() -> None:
    found = estimate(20)
    assert found is not None
    (model,) = found.models("a", "b")
    at = np.array([20])
    C = model.covariance(at, at)[0]
    seen = model.displacement(at, at)[0]
    along = seen / np.linalg.norm(seen)
    across = np.array([-along[1], along[0]])
    assert along @ C @ along == pytest.approx(0.3**2, rel=0.01)
    assert across @ C @ across == pytest.approx((0.02 * np.linalg.norm(seen)) ** 2, rel=0.05)


def test_links_without_a_range_make_no_route() -> None:
    assert estimate(5, 35, ranged=False) is None
