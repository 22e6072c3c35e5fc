"""What two robots know of each other before a frame transform is sought."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wiclosure.drift import DriftModel
from wiclosure.wiclosure_filter.consensus.problem import PairOdometry, heading_knowledge, reciprocal_partners


@pytest.mark.parametrize("kind", ["heading", "reciprocal", "one-way", "range-only"])
def test_the_strongest_knowledge_of_the_yaw_is_named(kind: str, make_case: Callable[..., object]) -> None:
    case = make_case(kind)
    assert case.problem.heading_knowledge == kind
    assert heading_knowledge(case.links, case.problem.partner) == kind
    assert np.isfinite(case.problem.prior.yaw) == (kind == "heading")


def test_the_settings_can_name_a_weaker_one(make_case: Callable[..., object]) -> None:
    assert make_case("reciprocal", heading="one-way").problem.heading_knowledge == "one-way"


def test_opposite_bearings_of_one_moment_are_partners(make_case: Callable[..., object]) -> None:
    links = make_case("reciprocal").links
    partner = reciprocal_partners(links, 0.5)
    np.testing.assert_array_equal(links.stamp_a_ns[partner], links.stamp_a_ns)
    np.testing.assert_array_equal(links.a_receives[partner], ~links.a_receives)
    alone = links.subset(np.flatnonzero(links.a_receives))
    assert (reciprocal_partners(alone, 0.5) == -1).all()
    apart = links.subset(np.array([0, 5]))  # another moment
    assert (reciprocal_partners(apart, 0.5) == -1).all()
    assert reciprocal_partners(apart, 1e3).tolist() == [1, 0]


def test_drift_grows_from_the_anchor(make_case: Callable[..., object]) -> None:
    model = DriftModel(translation_walk=0.1, rotation_walk=1e-3, rotation_walk_turning=1e-3)
    case = make_case(drift=model, heard=13)
    observations, odometry = case.problem.observations, replace(case.problem.odometry, scale=0.0)
    position, yaw = odometry.drift_from(6, observations)
    assert position[6] == yaw[6] == 0.0
    assert (np.diff(position[6:]) > 0).all()
    assert (np.diff(position[:7]) < 0).all()
    doubled = PairOdometry(odometry.a, odometry.b, 2 * odometry.inflation).drift_from(6, observations)
    np.testing.assert_allclose(doubled[0], 2 * position)
    np.testing.assert_allclose(doubled[1], 2 * yaw)


def test_a_random_walk_of_both_robots_adds_up(make_case: Callable[..., object]) -> None:
    """Both drive 1 m a second, and translations walk by 0.1 m per root of a metre."""
    walk = DriftModel(
        translation_walk=0.1, rotation_walk=1e-9, rotation_walk_turning=1e-9, translation_bias=0.0, rotation_bias=0.0
    )
    case = make_case(drift=walk, heard=13)
    observations, odometry = case.problem.observations, replace(case.problem.odometry, scale=0.0)
    position, yaw = odometry.drift_since(0, 0, observations)
    np.testing.assert_allclose(position, 0.1 * np.sqrt(2.0 * observations.index_a), rtol=1e-6)
    np.testing.assert_allclose(yaw, 0.0, atol=1e-7)
    between = odometry.covariance_a(np.array([0]), np.array([16]))
    np.testing.assert_allclose(np.diag(between[0])[3:], 16 * 0.1**2, rtol=1e-6)


def test_an_unknown_scale_moves_what_lies_far_from_where_the_transform_is_right(
    make_case: Callable[..., object],
) -> None:
    """By a percent of the way of each robot, in any direction."""
    case = make_case(drift=DriftModel().scaled(1e-6), heard=13)
    observations, odometry = case.problem.observations, replace(case.problem.odometry, scale=0.01)
    ways = [
        np.linalg.norm((t.positions[index] - t.positions[0])[:, :2], axis=1)
        for t, index in ((odometry.a, observations.index_a), (odometry.b, observations.index_b))
    ]
    np.testing.assert_allclose(odometry.drift_since(0, 0, observations)[0], 0.01 * np.hypot(*ways), atol=1e-6)


def test_the_anchored_likelihood_is_widened_by_the_drift(make_case: Callable[..., object]) -> None:
    case = make_case(drift=DriftModel(translation_walk=0.3, rotation_walk=0.01))
    mixture, (position, _) = case.problem.anchored_at(2)
    np.testing.assert_allclose(mixture.range_variance, 0.3**2 + position**2)
