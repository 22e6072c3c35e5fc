"""A frame transform that follows the drift of the odometry."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from wiclosure import se3
from wiclosure.drift import DriftModel
from wiclosure.types import FloatArray
from wiclosure.wiclosure_filter.config import CalibrationPriors
from wiclosure.wiclosure_filter.consensus.refinement import climb
from wiclosure.wiclosure_filter.drift.bordered_system import BorderedSystem
from wiclosure.wiclosure_filter.drift.calibration import COUNT
from wiclosure.wiclosure_filter.drift.drifting_frames import DriftingFrames, RigidTransform, follow_drifts

PERFECT = CalibrationPriors(
    range_bias_m=1e-5, range_scale=1e-6, clock_s=1e-6, mounting_rad=1e-6, scale=1e-6
)  # what is not to be estimated
DRIFT = DriftModel(translation_walk=0.01, rotation_walk=0.02)


def turning(rate_rad: float) -> Callable[[FloatArray], FloatArray]:
    """Odometry whose every step turns by a little too much."""

    def drifted(poses: FloatArray) -> FloatArray:
        out = [poses[0]]
        for step in se3.between(poses[:-1], poses[1:]) @ se3.from_yaw(rate_rad, np.zeros(3)):
            out.append(out[-1] @ step)
        return np.array(out)

    return drifted


def followed(rigid: RigidTransform) -> DriftingFrames:
    (found,) = follow_drifts([rigid])
    assert found is not None
    return found


@pytest.mark.parametrize("kind", ["heading", "reciprocal", "one-way"])
def test_without_drift_the_truth_stays(kind: str, make_case: Callable[..., object]) -> None:
    case = make_case(kind, drift=DRIFT)
    mixture, drift = case.problem.anchored_at(5)
    frames = followed(RigidTransform(case.state, mixture, drift, case.problem.prior, case.problem.odometry, PERFECT))
    np.testing.assert_allclose(frames.state, case.state, atol=1e-3)
    np.testing.assert_allclose(frames.yaw, case.state[0], atol=1e-3)
    true = se3.transform(case.T_a_b, case.links.antenna_b) - case.links.antenna_a
    np.testing.assert_allclose(frames.w, true, atol=1e-2)
    assert (np.linalg.eigvalsh(frames.covariance) > 0).all()


def test_the_yaw_follows_an_odometry_that_turns(make_case: Callable[..., object]) -> None:
    """b's odometry turns by 0.6 rad too much on its way: no rigid transform explains that, a chain does."""
    still = make_case("reciprocal", heard=30)
    case = make_case("reciprocal", heard=30, drift=DRIFT, odometry_of_b=turning(0.01))
    mixture, drift = case.problem.anchored_at(30)
    rigid = climb(case.state[None], mixture, case.problem.prior).states[0]
    frames = followed(RigidTransform(rigid, mixture, drift, case.problem.prior, case.problem.odometry, PERFECT))
    expected = case.state[0] - 0.01 * case.problem.observations.index_b
    assert np.abs(frames.yaw - expected).max() < 0.1  # most at the ends, where a walk is taken to stop
    assert np.abs(frames.yaw - expected)[15:45].max() < 0.02
    assert np.abs(rigid[0] - expected).max() > 0.2
    true = se3.transform(still.T_a_b, still.links.antenna_b) - still.links.antenna_a
    assert np.linalg.norm(frames.w - true, axis=1).max() < 0.7
    assert frames.explanation.ranged().all()
    assert frames.middle in np.flatnonzero(np.abs(case.problem.observations.index_a - 30) < 3)


def test_ranges_alone_lead_to_one_alignment_from_wherever_it_starts(make_case: Callable[..., object]) -> None:
    """A far robot lies on a circle: whole steps along its tangent would leave every range unexplained."""
    case = make_case("range-only", heard=30)
    mixture, drift = case.problem.anchored_at(15)
    starts = case.state + np.array([[0.0, 0.0, 0.0, 0.0], [0.03, 0.3, -0.3, 0.0], [-0.05, -1.0, 0.5, 0.0]])
    found = [
        followed(RigidTransform(start, mixture, drift, case.problem.prior, case.problem.odometry, CalibrationPriors()))
        for start in starts
    ]
    for frames in found:
        np.testing.assert_allclose(frames.w[:, :2], found[0].w[:, :2], atol=0.05)
        assert frames.explanation.ranged().all()


@pytest.mark.parametrize("with_border", [0.0, 1.0])
def test_the_bordered_system_is_the_dense_one(with_border: float) -> None:
    rng = np.random.default_rng(0)
    diagonal = rng.normal(size=(5, 4, 4))
    diagonal = diagonal @ np.swapaxes(diagonal, 1, 2) + 20 * np.eye(4)
    upper = rng.normal(size=(4, 4, 4))
    border, of_errors = with_border * rng.normal(size=(5, 4, COUNT)), 30 * np.eye(COUNT)
    dense = np.zeros((20 + COUNT, 20 + COUNT))
    for m in range(5):
        dense[4 * m : 4 * m + 4, 4 * m : 4 * m + 4] = diagonal[m]
    for m in range(4):
        dense[4 * m : 4 * m + 4, 4 * m + 4 : 4 * m + 8] = upper[m]
        dense[4 * m + 4 : 4 * m + 8, 4 * m : 4 * m + 4] = upper[m].T
    dense[:20, 20:] = border.reshape(20, COUNT)
    dense[20:, :20] = dense[:20, 20:].T
    dense[20:, 20:] = of_errors
    system = BorderedSystem(diagonal, upper, border, of_errors)
    inverse, rows = np.linalg.inv(dense), np.r_[8:12, 20 : 20 + COUNT]
    np.testing.assert_allclose(system.marginal(2), inverse[np.ix_(rows, rows)], atol=1e-12)
    np.testing.assert_allclose(system.covariance_of_errors(), inverse[20:, 20:], atol=1e-12)


def rigid_transforms(make_case: Callable[..., object]) -> list[RigidTransform]:
    """Of very different pairs of robots; of some drift matters, some have compasses, some climb."""
    found = []
    for kind, heard, changes in (
        ("heading", 9, {}),
        ("range-only", 20, {"drift": DRIFT}),
        ("reciprocal", 5, {"false_paths": 3}),
        ("one-way", 30, {"drift": DRIFT, "false_paths": 1, "elevated": True}),
        ("reciprocal", 12, {"drift": DRIFT, "odometry_of_b": turning(0.01)}),
    ):
        case = make_case(kind, heard=heard, **changes)
        mixture, drift = case.problem.anchored_at(heard // 2)
        if not found:
            drift = np.zeros(heard), np.zeros(heard)
        problem = case.problem
        found.append(RigidTransform(case.state, mixture, drift, problem.prior, problem.odometry, CalibrationPriors()))
    return found


def test_chains_that_are_followed_together_are_those_that_are_followed_alone(make_case: Callable[..., object]) -> None:
    rigid = rigid_transforms(make_case)
    assert {one.drift_matters for one in rigid} == {True, False}
    for together, one in zip(follow_drifts(rigid), rigid, strict=True):
        alone = followed(one)
        assert together is not None
        np.testing.assert_allclose(together.yaw, alone.yaw, atol=1e-9)
        np.testing.assert_allclose(together.w, alone.w, atol=1e-7)
        np.testing.assert_allclose(together.covariance, alone.covariance, rtol=1e-6, atol=1e-12)
        np.testing.assert_allclose(together.errors.value, alone.errors.value, rtol=1e-6, atol=1e-9)
        assert together.corrected.direction.shape == one.mixture.observations.direction.shape
        assert together.log_mass == pytest.approx(alone.log_mass, rel=1e-6)


def test_a_chain_without_digits_left_takes_no_other_with_it(make_case: Callable[..., object]) -> None:
    good = rigid_transforms(make_case)[:2]

    def far(poses: FloatArray) -> FloatArray:
        poses = poses.copy()
        poses[::2, :3, 3] *= 1e12
        return poses

    case = make_case("range-only", heard=20, odometry_of_b=far)
    mixture, drift = case.problem.anchored_at(10)
    problem = case.problem
    bad = RigidTransform(case.state, mixture, drift, problem.prior, problem.odometry, CalibrationPriors())
    assert follow_drifts([bad]) == [None]
    first, none, second = follow_drifts([good[0], bad, good[1]])
    assert none is None
    for found, alone in zip((first, second), follow_drifts(good), strict=True):
        assert found is not None
        assert alone is not None
        np.testing.assert_allclose(found.w, alone.w, atol=1e-7)
