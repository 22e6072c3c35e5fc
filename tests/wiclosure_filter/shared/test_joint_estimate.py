"""One optimisation over all robots of a component."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import AlignmentHypothesis, AoaPath, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.drift.calibration import BIAS, COUNT
from wiclosure.wiclosure_filter.likelihood.frame_prior import FramePrior
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.shared.constant_errors import PriorErrors
from wiclosure.wiclosure_filter.shared.graph_nodes import NodeSpacing, TeamNodes
from wiclosure.wiclosure_filter.shared.joint_estimate import JointEstimate
from wiclosure.wiclosure_filter.shared.joint_optimum import JointOptimum, optimise
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

SIZE = 60
FRAMES = {"a": np.eye(4), "b": se3.from_yaw(0.9, np.array([10.0, 4.0, 0.0])), "c": se3.from_yaw(-1, np.ones(3))}


def curve(seed: int) -> np.ndarray:
    yaw = np.cumsum(np.random.default_rng(seed).normal(0, 0.1, SIZE))
    return se3.from_yaw(yaw, np.cumsum(np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=1), axis=0))


def optimum(
    guess: np.ndarray, range_error_m: float = 0.0, bias_m: float = 0.0, known: PriorErrors | None = None
) -> tuple[JointOptimum, dict[str, Trajectory]]:
    stamps_ns = np.arange(SIZE, dtype=np.int64) * 10**9
    team = {name: Trajectory(name, stamps_ns, curve(seed)) for seed, name in enumerate("ab")}
    heard = []
    for k in range(0, SIZE, 5):
        seen = se3.between(team["a"].poses[k], FRAMES["b"] @ team["b"].poses[k])[:3, 3]
        path = AoaPath(float(np.arctan2(seen[1], seen[0])), 0.1)
        range_m = float(np.linalg.norm(seen)) + range_error_m * (k % 2) + bias_m
        heard.append(WirelessMeasurement(k * 10**9, "a", "b", range_m, 0.3, (path,)))
    links = TeamLinks.of(team, WirelessLog(tuple(heard)), GatheringLimits.of(AlignmentSettings())).by_pair["a", "b"]
    kept = KeptLinks.of(AlignmentHypothesis(guess, 0.0, tuple((k, 0) for k in range(len(heard)))), links)
    nodes = TeamNodes.along(team, {("a", "b"): kept}, NodeSpacing(20.0, 0.7))
    prior = FramePrior.of(AlignmentSettings(), 0.05)
    frames, errors = {"a": np.eye(4), "b": guess}, {} if known is None else {("a", "b"): known}
    found = optimise(nodes, frames, prior, robust_threshold=2.385, drift_weight=2.0, of_errors=errors)
    return found, team


def joint(guess: np.ndarray) -> JointEstimate:
    return JointEstimate.of(optimum(guess)[0])


def test_noise_free_links_give_the_true_places() -> None:
    best, team = optimum(FRAMES["b"] @ se3.from_yaw(0.2, np.array([2.0, -1.0, 0.0])))
    found = JointEstimate.of(best)
    np.testing.assert_allclose(found.positions["a"], team["a"].positions, atol=1e-3)
    np.testing.assert_allclose(found.positions["b"], se3.transform(FRAMES["b"], team["b"].positions), atol=5e-3)
    assert best.misfits()["a", "b"] < 0.05


def test_false_ranges_are_outvoted() -> None:
    """Half of the ranges are 30 m too long: the kernel leaves them aside."""
    best, team = optimum(FRAMES["b"], range_error_m=30.0)
    found = JointEstimate.of(best)
    off = found.positions["b"] - se3.transform(FRAMES["b"], team["b"].positions)
    assert np.linalg.norm(off[:, :2], axis=1).max() < 1.0


def test_misfit_tells_links_from_places_that_they_contradict() -> None:
    found, _ = optimum(FRAMES["b"])
    moved = found.T_world_node.copy()
    moved[found.team.first["b"] :, 0, 3] += 20.0
    elsewhere = replace(found, T_world_node=moved)
    assert elsewhere.misfits()["a", "b"] > 3.0


def test_a_bias_that_the_estimate_found_is_no_misfit() -> None:
    sigma = np.full(COUNT, 1e-3)
    sigma[BIAS] = 3.0
    found, _ = optimum(FRAMES["b"], bias_m=2.5, known=PriorErrors(np.zeros(COUNT), sigma))
    assert found.of_links["a", "b"][BIAS] == pytest.approx(2.5, abs=0.5)
    assert found.misfits()["a", "b"] < 0.5
    assert replace(found, of_links={}).misfits()["a", "b"] > 3.0


def test_of_no_pairs_nothing_is_predicted() -> None:
    found = joint(FRAMES["b"])
    none = np.zeros(0, np.int64)
    T_a_b, covariance = found.relative_poses("a", none, "b", none)
    assert (T_a_b.shape, covariance.shape) == ((0, 4, 4), (0, 6, 6))


def test_models_and_relative_poses_tell_the_same_displacement() -> None:
    found = joint(FRAMES["b"])
    (model,) = found.models("a", "b")
    p, k = np.array([0, 20, 50]), np.array([10, 30, 59])
    T_a_b, covariance = found.relative_poses("a", p, "b", k)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    lengths = np.linalg.norm(T_a_b[:, :3, 3], axis=1)
    np.testing.assert_allclose(lengths, np.linalg.norm(model.displacement(p, k), axis=1), atol=1e-3)
    # Bounds for the search, and the pose's own covariance, are of one size.
    ratio = np.trace(model.covariance(p, k), axis1=1, axis2=2) / np.trace(covariance[:, 3:5, 3:5], axis1=1, axis2=2)
    assert (ratio > 0.5).all()
    assert (ratio < 3.0).all()


def test_no_pairs_have_no_relative_poses() -> None:
    """As of a run in which no two places look alike."""
    found = joint(FRAMES["b"])
    none = np.zeros(0, np.int64)
    T_a_b, covariance = found.relative_poses("a", none, "b", none)
    assert T_a_b.shape == (0, 4, 4)
    assert covariance.shape == (0, 6, 6)
