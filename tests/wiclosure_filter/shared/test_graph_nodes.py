"""Few nodes for long trajectories: where they lie, what odometry tells between them, and which links they hold."""

from __future__ import annotations

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import AccumulatedDrift, DriftModel
from wiclosure.types import AlignmentHypothesis, Trajectory, WirelessLog, WirelessMeasurement
from wiclosure.wiclosure_filter.config import AlignmentSettings
from wiclosure.wiclosure_filter.links.gathering import GatheringLimits, TeamLinks
from wiclosure.wiclosure_filter.shared.graph_nodes import (
    LEAST_SIGMA,
    MOST_NODES,
    GraphNodes,
    NodeSpacing,
    TeamNodes,
    turned_so_far,
    without_bias,
)
from wiclosure.wiclosure_filter.shared.kept_links import KeptLinks

from ..one_road import winding_road  # noqa: TID252  -- test folders are no packages

DRIFT = DriftModel(translation_walk=0.05, rotation_walk=0.001, rotation_walk_turning=0.003)
NO_LINKS = (np.zeros(0, np.int64), np.zeros((0, 3)))


def straight(size: int = 121, drift: DriftModel = DRIFT) -> Trajectory:
    """A keyframe every metre along x."""
    x = np.arange(size, dtype=float)
    poses = se3.from_yaw(np.zeros(size), np.stack([x, 0 * x, 0 * x], axis=1))
    return Trajectory("alpha", np.arange(size, dtype=np.int64) * 10**9, poses, drift)


@pytest.mark.parametrize("size", [1, 2, 500])
def test_nodes_cover_the_trajectory(size: int) -> None:
    trajectory = Trajectory("alpha", np.arange(size, dtype=np.int64) * 10**9, winding_road(8, size, 20.0), DRIFT)
    links = np.unique(np.linspace(0, size - 1, 7).astype(int))
    nodes = GraphNodes.along(trajectory, links, trajectory.positions[links] + 0.1, NodeSpacing(60.0, 0.7))
    assert (np.diff(nodes.keyframe) >= 0).all()
    assert nodes.keyframe[0] == 0
    assert nodes.keyframe[-1] == size - 1
    assert len(nodes) <= MOST_NODES + 2 + len(links) * 2
    np.testing.assert_array_equal(nodes.keyframe[nodes.of_link], links)
    before, share = nodes.around_keyframes()
    assert ((share >= 0) & (share <= 1)).all()
    assert (nodes.keyframe[before] <= np.arange(size)).all()
    assert (np.linalg.eigvalsh(nodes.steps()[1]) > 0).all()


def test_steps_between_nodes_follow_the_drift_model() -> None:
    trajectory = Trajectory("alpha", np.arange(300, dtype=np.int64) * 10**9, winding_road(9, 300), DRIFT)
    nodes = GraphNodes.along(trajectory, np.zeros(0, np.int64), np.zeros((0, 3)), NodeSpacing(60.0, 0.7))
    _, covariance = nodes.steps()
    i, j = nodes.keyframe[:-1], nodes.keyframe[1:]
    expected = AccumulatedDrift.along(trajectory.poses, DRIFT).covariance(trajectory.poses, i, j)
    turn = np.zeros((len(j), 6, 6))
    turn[:, :3, :3] = turn[:, 3:, 3:] = trajectory.poses[j, :3, :3]
    np.testing.assert_allclose(covariance, se3.rotate_covariance(turn, expected), atol=1.1e-6)


def test_walk_that_replaces_a_bias_is_nowhere_smaller() -> None:
    biased = DriftModel(
        translation_walk=0.02,
        rotation_walk=0.0005,
        rotation_walk_turning=0.002,
        translation_bias=0.005,
        rotation_bias=5e-5,
    )
    trajectory = Trajectory("alpha", np.arange(300, dtype=np.int64) * 10**9, winding_road(10, 300), biased)
    walk = without_bias(biased, float(trajectory.distance[-1]))
    assert walk.translation_bias == walk.rotation_bias == 0
    zero, j = np.zeros(299, np.int64), np.arange(1, 300)
    of_walk = AccumulatedDrift.along(trajectory.poses, walk).covariance(trajectory.poses, zero, j)
    rotation = trajectory.relative_covariance(zero, j)[:, :3, :3]
    assert (np.linalg.eigvalsh(of_walk[:, :3, :3] - rotation) > -1e-12).all()


def test_a_straight_road_has_a_node_every_so_many_metres() -> None:
    nodes = GraphNodes.along(straight(), *NO_LINKS, NodeSpacing(40.0, 0.7))
    assert nodes.keyframe.tolist() == [0, 40, 80, 120]
    np.testing.assert_allclose(nodes.position, straight().positions[nodes.keyframe])


def test_turns_have_nodes_too() -> None:
    turn = np.concatenate([np.zeros(60), np.linspace(0, 2.0, 61)])
    trajectory = Trajectory("alpha", np.arange(121) * 10**9, se3.from_yaw(turn, straight().positions), DRIFT)
    np.testing.assert_allclose(turned_so_far(trajectory), turn, atol=1e-7)
    nodes = GraphNodes.along(trajectory, *NO_LINKS, NodeSpacing(1e6, 0.7))
    assert (np.diff(turn[nodes.keyframe]) <= 0.75).all()
    assert len(nodes) == 4


def test_links_of_one_instant_share_a_node() -> None:
    keyframe, position = np.array([7, 7, 7]), np.array([[7.0, 0, 1], [7.0, 0, 1], [7.0, 0, 2]])
    nodes = GraphNodes.along(straight(), keyframe, position, NodeSpacing(1e6, 1e6))
    assert nodes.of_link[0] == nodes.of_link[1] != nodes.of_link[2]
    np.testing.assert_allclose(nodes.position[nodes.of_link], position)


def test_the_bridge_is_none_at_nodes_and_widest_between() -> None:
    nodes = GraphNodes.along(straight(), *NO_LINKS, NodeSpacing(60.0, 0.7))
    before, share = nodes.around_keyframes()
    variance = nodes.bridge_variance(before, share)
    np.testing.assert_allclose(variance[nodes.keyframe], 0.0, atol=1e-12)
    h = 30.0 / 2  # half way: s (l - s) / l
    walk = nodes.drift
    assert variance[30] == pytest.approx(walk.translation_walk**2 * h + walk.rotation_walk**2 * 60 * h**2 / 3)
    assert variance.argmax() in {30, 90}


def test_scaled_drift_scales_the_steps() -> None:
    nodes = GraphNodes.along(straight(), *NO_LINKS, NodeSpacing(60.0, 0.7))
    floor = LEAST_SIGMA**2 * np.eye(6)
    plain, doubled = (n.steps()[1] - floor for n in (nodes, nodes.with_drift_scaled(2.0)))
    np.testing.assert_allclose(doubled, 4 * plain)


def test_a_teams_nodes_know_their_links() -> None:
    team = {"alpha": straight(), "beta": straight(61)}
    heard = tuple(WirelessMeasurement(k * 10**9, "alpha", "beta", 5.0, 0.5) for k in (10, 30))
    links = TeamLinks.of(team, WirelessLog(heard), GatheringLimits.of(AlignmentSettings())).by_pair["alpha", "beta"]
    kept = KeptLinks.of(AlignmentHypothesis(np.eye(4), 0.0, ((0, -1), (1, -1))), links)
    nodes = TeamNodes.along(team, {("alpha", "beta"): kept}, NodeSpacing(60.0, 0.7))
    at_a, at_b = nodes.ends["alpha", "beta"]
    assert nodes.nodes["alpha"].keyframe[at_a].tolist() == nodes.nodes["beta"].keyframe[at_b].tolist() == [10, 30]
    assert nodes.first == {"alpha": 0, "beta": len(nodes.nodes["alpha"])}
