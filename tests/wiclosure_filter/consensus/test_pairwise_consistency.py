"""Loops of two links: true ones close, a reflection closes with none of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.wiclosure_filter.consensus.pairwise_consistency import consistency, full_links, pairwise_consistency


@pytest.mark.parametrize("kind", ["heading", "reciprocal"])
def test_every_noise_free_path_asks_for_the_true_transform(kind: str, make_case: Callable[..., object]) -> None:
    case = make_case(kind)
    links = full_links(case.problem, max_links=600, height_ratio=0.1)
    assert len(links) == 12
    np.testing.assert_allclose(se3.wrap_angle(links.state[:, 0] - case.state[0]), 0, atol=1e-6)
    np.testing.assert_allclose(links.state[:, 1:], np.tile(case.state[1:], (12, 1)), atol=1e-4)
    assert (np.linalg.eigvalsh(links.covariance[:, 2:, 2:]) > 0).all()


def test_covariance_of_a_link_is_range_along_and_bearing_across(make_case: Callable[..., object]) -> None:
    case = make_case("heading")
    links = full_links(case.problem, max_links=600, height_ratio=0.1)
    observations = case.problem.observations
    seen = np.linalg.inv(case.trajectories["b"].poses[observations.index_b, :3, :3]) @ (
        se3.inverse(case.T_a_b)[:3, :3] @ (case.links.direction[:, 0] * case.links.range_m[:, None])[:, :, None]
    )
    along = (seen / case.links.range_m[:, None, None])[..., 0]
    across = np.stack([-along[:, 1], along[:, 0], 0 * along[:, 0]], axis=1)
    C = links.covariance[:, 3:, 3:]
    np.testing.assert_allclose(np.einsum("mi,mij,mj->m", along, C, along), 0.3**2, rtol=1e-3)
    sideways = np.einsum("mi,mij,mj->m", across, C, across)
    np.testing.assert_allclose(sideways, (0.15 * case.links.range_m) ** 2, rtol=1e-3)


def test_true_links_are_consistent_and_false_ones_with_none(make_case: Callable[..., object]) -> None:
    case = make_case("heading", false_paths=1, heard=20)
    links = full_links(case.problem, max_links=600, height_ratio=0.1)
    consistent = consistency(links, case.problem.observations, case.problem.odometry, 0.95)
    np.testing.assert_array_equal(consistent, consistent.T)
    assert not consistent[links.row[:, None] == links.row[None, :]].any()  # at most one path of a measurement
    off = np.linalg.norm(links.state[:, 1:3] - case.state[1:3], axis=1)
    direct, false = np.flatnonzero(off < 0.1), np.flatnonzero(off > 10.0)
    assert len(direct) >= 20
    assert consistent[np.ix_(direct, direct)][links.row[direct][:, None] != links.row[direct][None, :]].all()
    near = np.linalg.norm(case.problem.observations.a[links.row[false]] - case.state[1:], axis=1)
    assert len(near) > 5
    assert consistent[np.ix_(false, direct)].mean() < 0.2


def test_the_largest_set_is_the_direct_paths(make_case: Callable[..., object]) -> None:
    case = make_case("heading", false_paths=3, heard=20)
    found = pairwise_consistency(case.problem, 0.95, max_links=600, height_ratio=0.1)
    assert found is not None
    assert found.chosen is not None
    direct = case.links.path[np.arange(20), found.chosen[0]]
    assert (found.chosen[0] >= 0).all()
    assert np.mean(direct == 0) >= 0.7  # a false path beside the direct one is consistent too
    assert np.linalg.norm((found.peaks.states[0] - case.state)[1:3]) < 1.0
    assert len(found.peaks) == 2  # and the best set of what is left


def test_only_the_heaviest_links_are_looked_at(make_case: Callable[..., object]) -> None:
    case = make_case("heading", false_paths=3)
    assert len(full_links(case.problem, max_links=7, height_ratio=0.1)) == 7


@pytest.mark.parametrize("kind", ["one-way", "range-only"])
def test_without_relative_headings_there_is_nothing_to_compare(kind: str, make_case: Callable[..., object]) -> None:
    assert pairwise_consistency(make_case(kind).problem, 0.95, max_links=600, height_ratio=0.1) is None
