"""Noise-free measurements: the true frame transform is among the proposals of every kind."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.consensus import proposals
from wiclosure.wiclosure_filter.consensus.proposals import Correspondences


def nearest(states: FloatArray, state: FloatArray) -> float:
    off = states - state
    off[:, 0] = se3.wrap_angle(off[:, 0])
    return float(np.abs(off[:, :3]).max(axis=1).min())


def test_correspondences_meet_under_the_true_transform(make_case: Callable[..., object]) -> None:
    case = make_case("reciprocal", elevated=True)
    points = Correspondences.of(case.problem.observations)
    np.testing.assert_allclose(se3.transform(se3.from_yaw(case.state[0], case.state[1:]), points.b), points.a)
    distance = case.problem.observations.range_m[points.row]
    np.testing.assert_allclose(points.sigma_m, np.hypot(0.15 * distance, 0.3))


def test_known_yaw(make_case: Callable[..., object]) -> None:
    case = make_case("heading", false_paths=2)
    points = Correspondences.of(case.problem.observations)
    states = proposals.from_known_yaw(points, float(case.state[0]), 0.1)
    assert len(states) == 3 * len(points.row)
    assert nearest(states, case.state) < 1e-9
    np.testing.assert_allclose(np.unique((states[:, 0] - case.state[0]).round(9)), [-0.1, 0.0, 0.1])
    assert proposals.from_known_yaw(points, np.nan, np.nan).shape == (0, 4)


def test_pairs_of_correspondences(make_case: Callable[..., object]) -> None:
    case = make_case(false_paths=2)
    states = proposals.from_pairs(Correspondences.of(case.problem.observations), np.arange(12), 5_000)
    assert nearest(states, case.state) < 1e-9
    few = proposals.from_pairs(Correspondences.of(case.problem.observations), np.arange(12), 10)
    assert len(few) == 10


def test_only_the_chosen_measurements_are_paired(make_case: Callable[..., object]) -> None:
    case = make_case()
    points = Correspondences.of(case.problem.observations)
    assert len(proposals.from_pairs(points, np.array([3]), 100)) == 0
    assert len(proposals.from_pairs(points, np.array([3, 9]), 100)) == 1


def test_reciprocal_bearings(make_case: Callable[..., object]) -> None:
    case = make_case("reciprocal", false_paths=1)
    points = Correspondences.of(case.problem.observations)
    states = proposals.from_reciprocal(points, case.problem.observations, case.problem.partner, 10_000)
    assert len(states) == 12 * 2 * 2  # each of a's two paths with each of b's
    assert nearest(states, case.state) < 1e-9
    assert len(proposals.from_reciprocal(points, case.problem.observations, case.problem.partner, 7)) == 7


def test_circles_of_two_ranges(make_case: Callable[..., object]) -> None:
    case = make_case("range-only")
    states = proposals.from_circles(case.problem.observations, np.arange(12), case.state[:1], 10_000)
    assert nearest(states, case.state) < 1e-6
    assert len(proposals.from_circles(case.problem.observations, np.arange(12), case.state[:1] + 1.0, 10)) <= 10


def test_rays_of_two_bearings(make_case: Callable[..., object]) -> None:
    case = make_case("bearing-only", false_paths=1)
    states = proposals.from_rays(case.problem.observations, np.arange(12), case.state[:1], 10_000)
    assert nearest(states, case.state) < 1e-6
    assert len(Correspondences.of(case.problem.observations).row) == 0  # nothing was ranged


@pytest.mark.parametrize("limit", [1, 50, 10**6])
def test_the_same_proposals_every_time(limit: int, make_case: Callable[..., object]) -> None:
    points = Correspondences.of(make_case(false_paths=4, heard=30).problem.observations)
    first, again = (proposals.from_pairs(points, np.arange(30), limit) for _ in range(2))
    np.testing.assert_array_equal(first, again)
    assert len(first) <= limit


def test_the_grid_goes_around_once() -> None:
    grid = proposals.yaw_grid()
    np.testing.assert_allclose(np.diff(grid), 2 * np.pi / len(grid))
    assert grid[0] == -np.pi
