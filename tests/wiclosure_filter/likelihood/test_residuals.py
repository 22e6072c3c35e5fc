"""Residuals vanish at the truth; derivatives are those of finite differences."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.likelihood.residuals import (
    derivative_by_displacement,
    displacements_in_a,
    explained,
    mode,
    residual_rows,
    seen_by_receiver,
)


def spherical(w: FloatArray) -> FloatArray:
    flat = np.hypot(w[..., 0], w[..., 1])
    return np.stack(
        [np.arctan2(w[..., 1], w[..., 0]), np.arctan2(w[..., 2], flat), np.linalg.norm(w, axis=-1)], axis=-1
    )


def test_derivative_by_displacement_is_the_finite_difference() -> None:
    w = np.random.default_rng(0).normal(0, 10, (1, 30, 3))
    exact = derivative_by_displacement(w, np.hypot(w[..., 0], w[..., 1]), np.linalg.norm(w, axis=-1))
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis]
        difference = spherical(w + step) - spherical(w - step)
        difference[..., 0] = se3.wrap_angle(difference[..., 0])
        np.testing.assert_allclose(exact[..., axis], difference / 2e-5, atol=1e-6)


@pytest.mark.parametrize("kind", ["heading", "reciprocal", "one-way", "range-only"])
@pytest.mark.parametrize("elevated", [False, True])
def test_residuals_vanish_at_the_truth(kind: str, elevated: bool, make_case: Callable[..., object]) -> None:
    case = make_case(kind, elevated=elevated)
    mixture, _ = case.problem.anchored_at(0)
    _, w = displacements_in_a(case.state[None], case.problem.observations)
    rows = residual_rows(w, case.state[None, :1], mixture)
    np.testing.assert_allclose(rows.residual, 0, atol=1e-9)
    measured = [kind != "range-only", kind != "range-only" and elevated, True]
    np.testing.assert_array_equal((rows.weight[0] > 0).all(axis=0), measured)


def test_predictions_turn_with_the_yaw_where_b_receives(make_case: Callable[..., object]) -> None:
    case = make_case("reciprocal")
    mixture, _ = case.problem.anchored_at(0)
    _, w = displacements_in_a(case.state[None], case.problem.observations)
    before, after = (residual_rows(w, case.state[None, :1] + turn, mixture).residual for turn in (-1e-5, 1e-5))
    rows = residual_rows(w, case.state[None, :1], mixture)
    np.testing.assert_allclose((after - before) / 2e-5, -rows.by_yaw, atol=1e-5)
    np.testing.assert_array_equal(rows.by_yaw[0, :, 0], np.where(case.problem.observations.a_receives, 0.0, -1.0))


def test_displacements_are_those_of_the_frame_transform(make_case: Callable[..., object]) -> None:
    case = make_case("reciprocal", elevated=True)
    links, observations = case.links, case.problem.observations
    _, w = displacements_in_a(case.state[None], observations)
    np.testing.assert_allclose(w[0], se3.transform(case.T_a_b, links.antenna_b) - links.antenna_a, atol=1e-9)
    seen = seen_by_receiver(w, case.state[None, :1], ~observations.a_receives)[0]
    from_b = se3.transform(se3.inverse(case.T_a_b), links.antenna_a) - links.antenna_b
    np.testing.assert_allclose(seen[~links.a_receives], from_b[~links.a_receives], atol=1e-9)


def test_the_direct_path_explains_the_bearing_at_the_truth(make_case: Callable[..., object]) -> None:
    case = make_case(false_paths=3, heard=20)
    mixture, _ = case.problem.anchored_at(0)
    explanation = explained(case.state, mixture)
    direct = case.links.path[np.arange(20), explanation.direct()]
    assert np.mean(direct == 0) >= 0.9  # a false path may lie beside it
    assert explanation.ranged().all()


def test_the_mode_is_the_mean_of_the_values_that_most_share() -> None:
    assert mode(np.array([9.0, 3.0, 3.2, -40.0, 2.8, 8.9]), 0.5) == pytest.approx(3.0)
