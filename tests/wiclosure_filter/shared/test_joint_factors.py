"""The factors of the joint estimate: no error at the truth, and one standard deviation where it is due."""

from __future__ import annotations

import gtsam
import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import AlignmentHypothesis, AoaPath, Heading, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.likelihood.frame_prior import FramePrior
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.shared.graph_nodes import GraphNodes, NodeSpacing
from wiclosure.wiclosure_filter.shared.joint_factors import (
    add_first_guess,
    frame_factors,
    link_factors,
    step_factors,
)
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

STAMPS_NS = np.arange(3, dtype=np.int64) * 10**9
T_A_B = se3.from_yaw(0.8, np.array([3.0, 4.0, 1.0]))


def poses(*transforms: np.ndarray) -> gtsam.Values:
    values = gtsam.Values()
    for key, T in enumerate(transforms):
        values.insert(key, gtsam.Pose3(T))
    return values


def link_graph(measurement: WirelessMeasurement, headings: tuple[Heading, ...] = ()) -> gtsam.NonlinearFactorGraph:
    """Factors between the odometry frames themselves: both antennas lie at the origins."""
    team = {name: Trajectory(name, STAMPS_NS, np.tile(np.eye(4), (3, 1, 1))) for name in ("a", "b")}
    log = WirelessLog((measurement,), headings)
    links = TeamLinks.of(team, log, GatheringLimits.of(AlignmentSettings())).by_pair["a", "b"]
    kept = KeptLinks.of(AlignmentHypothesis(T_A_B, 0.0, ((0, 0 if measurement.paths else -1),)), links)
    return link_factors(kept, np.array([0]), np.array([1]), robust_threshold=1e6)


@pytest.mark.parametrize("receiver", ["a", "b"])
def test_ranges_and_bearings_fit_at_the_truth(receiver: str) -> None:
    seen = (T_A_B if receiver == "a" else se3.inverse(T_A_B))[:3, 3]
    distance = float(np.linalg.norm(seen))
    path = AoaPath(float(np.arctan2(seen[1], seen[0])), 0.1, elevation=float(np.arcsin(seen[2] / distance)))
    transmitter = "b" if receiver == "a" else "a"
    graph = link_graph(WirelessMeasurement(10**9, receiver, transmitter, distance, 0.5, (path,)))
    assert graph.size() == 2  # one false measurement does not take the other with it
    assert graph.error(poses(np.eye(4), T_A_B)) == pytest.approx(0.0, abs=1e-6)
    assert graph.error(poses(np.eye(4), T_A_B @ se3.from_yaw(0.0, np.array([1.0, -1.0, 0.0])))) > 0.1


def test_a_range_off_by_two_sigma_costs_two() -> None:
    graph = link_graph(WirelessMeasurement(0, "a", "b", float(np.linalg.norm(T_A_B[:3, 3])) + 1.0, 0.5))
    assert graph.error(poses(np.eye(4), T_A_B)) == pytest.approx(0.5 * 2.0**2, rel=1e-6)


def test_compasses_hold_the_yaw_alone() -> None:
    headings = (Heading(0, "a", 0.0, 0.05), Heading(0, "b", 0.8, 0.05))
    graph = link_graph(WirelessMeasurement(0, "a", "b", float(np.linalg.norm(T_A_B[:3, 3])), 0.5), headings)
    assert graph.error(poses(np.eye(4), T_A_B)) == pytest.approx(0.0, abs=1e-6)
    sigma = 0.05 * np.sqrt(2)
    turned = T_A_B @ se3.from_yaw(sigma, np.zeros(3))
    assert graph.error(poses(np.eye(4), turned)) == pytest.approx(0.5, rel=1e-2)


def test_odometry_ties_neighbouring_nodes() -> None:
    yaw = np.linspace(0, 2, 150)
    road = se3.from_yaw(yaw, np.cumsum(np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=1), axis=0))
    trajectory = Trajectory("a", np.arange(150) * 10**9, road, DriftModel())
    nodes = GraphNodes.along(trajectory, np.zeros(0, np.int64), np.zeros((0, 3)), NodeSpacing(30.0, 0.7))
    graph = step_factors({"a": nodes}, {"a": 0})
    assert graph.size() == len(nodes) - 1
    values = gtsam.Values()
    add_first_guess(values, 0, nodes, T_A_B)
    assert graph.error(values) == pytest.approx(0.0, abs=1e-9)
    np.testing.assert_allclose(values.atPose3(2).translation(), se3.transform(T_A_B, nodes.position[2]), atol=1e-9)
    np.testing.assert_allclose(values.atPose3(2).rotation().matrix(), T_A_B[:3, :3], atol=1e-9)


def test_the_first_frame_is_held_and_the_others_lean_a_little() -> None:
    prior = FramePrior.of(AlignmentSettings(), 0.05)
    graph = frame_factors(poses(np.eye(4), np.eye(4)), {"a": 0, "b": 1}, prior)
    assert graph.size() == 2
    lean = se3.exp(np.array([0.05 * np.sqrt(2), 0, 0, 0, 0, 0]))
    far = se3.from_yaw(0.0, np.array([100.0, 0.0, 0.0]))
    assert graph.error(poses(np.eye(4), lean)) == pytest.approx(0.5, rel=1e-3)
    assert graph.error(poses(np.eye(4), far)) < 1e-3  # nothing is known of the place
    assert graph.error(poses(lean, np.eye(4))) > 1e4
